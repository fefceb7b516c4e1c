// Sum of one vec4 per invocation of a workgroup.

#import lib/array

var<workgroup> sums: array<vec4<f32>, 256>;

fn reduce(value: vec4<f32>, lane: u32) -> vec4<f32> {
    sums[lane] = value;
    workgroupBarrier();
    for (var half = WORKGROUP / 2u; half > 0u; half = half >> 1u) {
        if lane < half {
            sums[lane] += sums[lane + half];
        }
        workgroupBarrier();
    }
    // The load makes the value uniform for the compiler, so barriers may depend on it; it also acts
    // as a barrier before and after.
    return workgroupUniformLoad(&sums[0]);
}
