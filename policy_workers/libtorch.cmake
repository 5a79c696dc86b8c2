# comrad_torch: libtorch's headers and libraries as one target, Debian's or those of a PyTorch from pip.
#
#   COMRAD_TORCH       empty: libtorch-dev (CPU). Else the folder of a PyTorch from pip, 2.7 or newer: a virtual environment, its
#                      site-packages, or the folder torch in it. ./comrad chooses (its COMRAD_TORCH is a wider word).
#   COMRAD_CUDA_INCLUDE  where cuda_runtime_api.h is, if not in the wheels beside that torch
#
# PyTorch's own CMake files are not used: those of a CUDA build stop where there is no CUDA toolkit with nvcc. Its wheel and
# NVIDIA's beside it hold all that our sources need. With CUDA, targets that use comrad_torch see COMRAD_HAS_CUDA.
set(COMRAD_TORCH "" CACHE PATH "Folder of a PyTorch from pip; empty: Debian's libtorch")
set(COMRAD_CUDA_INCLUDE "" CACHE PATH "Folder of cuda_runtime_api.h; empty: the wheels beside PyTorch")

add_library(comrad_torch INTERFACE)

if(NOT COMRAD_TORCH)
  find_package(Torch REQUIRED GLOBAL)
  target_link_libraries(comrad_torch INTERFACE ${TORCH_LIBRARIES})
  target_include_directories(comrad_torch SYSTEM INTERFACE ${TORCH_INCLUDE_DIRS})
  message(STATUS "libtorch ${Torch_VERSION} of Debian, CPU")
  return()
endif()

# Where torch is: the folder with lib/libtorch.so and the headers.
file(GLOB torch_candidates LIST_DIRECTORIES true ${COMRAD_TORCH} ${COMRAD_TORCH}/torch
  ${COMRAD_TORCH}/lib*/python3*/site-packages/torch ${COMRAD_TORCH}/lib*/python3*/dist-packages/torch)
set(torch_dir "")
foreach(candidate IN LISTS torch_candidates)
  if(EXISTS ${candidate}/lib/libtorch.so AND EXISTS ${candidate}/include/torch/csrc/api/include/torch/torch.h)
    file(REAL_PATH ${candidate} torch_dir)
    break()
  endif()
endforeach()
if(NOT torch_dir)
  message(FATAL_ERROR "COMRAD_TORCH=${COMRAD_TORCH}: no PyTorch there (lib/libtorch.so and its headers). Name a virtual "
    "environment with PyTorch, its site-packages, or the folder torch in it.")
endif()

# Which one it is.
set(torch_version "")
foreach(file IN ITEMS version.py build-version)
  if(NOT torch_version AND EXISTS ${torch_dir}/${file})
    file(STRINGS ${torch_dir}/${file} torch_version LIMIT_COUNT 1 REGEX "^(__version__ = ')?[0-9]+\\.[0-9]+")
    string(REGEX REPLACE "^(__version__ = ')?([0-9][^' ]*).*" "\\2" torch_version "${torch_version}")
  endif()
endforeach()
set(torch_config "")
if(EXISTS ${torch_dir}/share/cmake/Torch/TorchConfig.cmake)
  file(STRINGS ${torch_dir}/share/cmake/Torch/TorchConfig.cmake torch_config REGEX "_GLIBCXX_USE_CXX11_ABI=0")
endif()
if(torch_config OR (torch_version AND torch_version VERSION_LESS 2.7))
  message(FATAL_ERROR "${torch_dir}: PyTorch ${torch_version} has the C++ ABI from before C++11, so its libraries do not fit "
    "Debian's. Take 2.7 or newer.")
endif()

# Our own libraries come first: PyTorch carries other headers of fmt, which spdlog uses, of protobuf, and of a newer oneDNN, whose
# functions it keeps to itself.
set(first_dir ${CMAKE_BINARY_DIR}/headers-before-torch)
file(MAKE_DIRECTORY ${first_dir})
foreach(name IN ITEMS fmt google oneapi)
  if(EXISTS ${torch_dir}/include/${name})
    find_path(COMRAD_BEFORE_TORCH_${name} NAMES ${name}/core.h ${name}/protobuf/message.h ${name}/dnnl/dnnl.hpp)
    mark_as_advanced(COMRAD_BEFORE_TORCH_${name})
    if(COMRAD_BEFORE_TORCH_${name})
      file(CREATE_LINK ${COMRAD_BEFORE_TORCH_${name}}/${name} ${first_dir}/${name} SYMBOLIC)
    endif()
  endif()
endforeach()
target_include_directories(comrad_torch SYSTEM INTERFACE
  ${first_dir} ${torch_dir}/include ${torch_dir}/include/torch/csrc/api/include)

# The engines of c10d that this PyTorch was built with, in its own words.
set(torch_defines "")
if(EXISTS ${torch_dir}/share/cmake/Caffe2/Caffe2Targets.cmake)
  file(STRINGS ${torch_dir}/share/cmake/Caffe2/Caffe2Targets.cmake torch_defines REGEX "INTERFACE_COMPILE_DEFINITIONS")
endif()
foreach(define IN ITEMS USE_DISTRIBUTED USE_C10D_GLOO)
  if(torch_defines MATCHES "[\";]${define}[\";\\\\]")
    target_compile_definitions(comrad_torch INTERFACE ${define})
  endif()
endforeach()

# Full paths: CMake then writes their folder into the programs (RUNPATH), and the wheel's libraries find NVIDIA's themselves.
target_link_libraries(comrad_torch INTERFACE ${torch_dir}/lib/libtorch_cpu.so ${torch_dir}/lib/libc10.so)
set(torch_kind "CPU")
if(EXISTS ${torch_dir}/lib/libtorch_cuda.so)
  file(GLOB cuda_includes LIST_DIRECTORIES true ${torch_dir}/../nvidia/*/include)
  if(COMRAD_CUDA_INCLUDE)
    list(PREPEND cuda_includes ${COMRAD_CUDA_INCLUDE})
  endif()
  set(runtime_header "")
  foreach(include IN LISTS cuda_includes)
    if(NOT runtime_header AND EXISTS ${include}/cuda_runtime_api.h)
      set(runtime_header ${include}/cuda_runtime_api.h)
    endif()
  endforeach()
  if(NOT runtime_header)
    message(FATAL_ERROR "${torch_dir} has CUDA, but NVIDIA's wheels with cuda_runtime_api.h are not beside it. Install it with "
      "what it depends on (pip install torch), or name the folder of that header: -DCOMRAD_CUDA_INCLUDE=FOLDER.")
  endif()
  file(STRINGS ${runtime_header} includes_crt REGEX "#include \"crt/host_defines.h\"")
  get_filename_component(runtime_folder ${runtime_header} DIRECTORY)
  if(includes_crt AND NOT EXISTS ${runtime_folder}/crt/host_defines.h)
    message(FATAL_ERROR "${runtime_header} includes crt/host_defines.h, which PyTorch does not depend on. Install it beside that "
      "PyTorch: python -m pip install 'cuda-toolkit[crt,cccl]', where python is the one that has it.")
  endif()
  file(GLOB cuda_runtime ${torch_dir}/../nvidia/*/lib/libcudart.so.* ${torch_dir}/lib/libcudart*.so*)
  if(NOT cuda_runtime)
    message(FATAL_ERROR "${torch_dir} has CUDA, but no libcudart.so lies beside it. Install it with what it depends on "
      "(pip install torch).")
  endif()
  list(GET cuda_runtime 0 cuda_runtime)
  target_include_directories(comrad_torch SYSTEM INTERFACE ${cuda_includes})
  target_compile_definitions(comrad_torch INTERFACE COMRAD_HAS_CUDA)
  # Nothing of ours may call libtorch_cuda.so: being loaded, it registers its kernels.
  target_link_libraries(comrad_torch INTERFACE
    "-Wl,--push-state,--no-as-needed,${torch_dir}/lib/libtorch_cuda.so,--pop-state"
    ${torch_dir}/lib/libc10_cuda.so ${cuda_runtime})
  file(STRINGS ${runtime_header} cudart_version LIMIT_COUNT 1 REGEX "define CUDART_VERSION")
  string(REGEX REPLACE "[^0-9]*([0-9]+).*" "\\1" cudart_version "${cudart_version}")
  math(EXPR cuda_major "${cudart_version} / 1000")
  math(EXPR cuda_minor "${cudart_version} % 1000 / 10")
  set(torch_kind "CUDA ${cuda_major}.${cuda_minor}")
  # c10d's NCCL requires headers that PyTorch does not depend on either. Without them learners exchange by way of the host.
  set(has_nccl NO)
  foreach(include IN LISTS cuda_includes)
    if(torch_defines MATCHES "[\";]USE_C10D_NCCL[\";\\]" AND EXISTS ${include}/nv/target)
      set(has_nccl YES)
    endif()
  endforeach()
  if(has_nccl)
    target_compile_definitions(comrad_torch INTERFACE USE_C10D_NCCL)
  else()
    message(STATUS "no nv/target or no NCCL beside that PyTorch: several learners exchange gradients by way of the host")
  endif()
endif()
file(GLOB torch_library_dirs LIST_DIRECTORIES true ${torch_dir}/lib ${torch_dir}/../nvidia/*/lib)
set(COMRAD_TORCH_LIBRARY_DIRS ${torch_library_dirs} CACHE INTERNAL "For deploy/package")
message(STATUS "PyTorch ${torch_version}, ${torch_kind}: ${torch_dir}")
