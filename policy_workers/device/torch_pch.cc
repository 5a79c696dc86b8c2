// Owns the precompiled torch_ops.h that every target with comrad_use_torch() shares.
