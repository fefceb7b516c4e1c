//! Files in and out: one file a format. Nothing here knows of the GPU.
