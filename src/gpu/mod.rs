//! The device, GPU-resident arrays, passes, shader composition, read-back and timing.
