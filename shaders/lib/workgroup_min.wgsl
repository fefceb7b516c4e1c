// Minimum of one number per invocation of a workgroup.

#import lib/array

var<workgroup> minima: array<f32, 256>;

fn workgroup_min(value: f32, lane: u32) -> f32 {
    minima[lane] = value;
    workgroupBarrier();
    for (var half = WORKGROUP / 2u; half > 0u; half = half >> 1u) {
        if lane < half {
            minima[lane] = min(minima[lane], minima[lane + half]);
        }
        workgroupBarrier();
    }
    return workgroupUniformLoad(&minima[0]);
}
