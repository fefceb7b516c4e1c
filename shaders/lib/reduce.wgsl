// The sum of one vec4 from every invocation of a workgroup.

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
    // Uniform to the compiler too, which may then allow barriers behind a test of it; a barrier
    // before and after.
    return workgroupUniformLoad(&sums[0]);
}
