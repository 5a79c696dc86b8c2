// Owns the precompiled test_pch.h that the tests without libtorch share (CMakeLists.txt).
