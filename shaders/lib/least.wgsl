// The least of one number from every invocation of a workgroup.

#import lib/array

var<workgroup> lows: array<f32, 256>;

fn least_of(value: f32, lane: u32) -> f32 {
    lows[lane] = value;
    workgroupBarrier();
    for (var half = WORKGROUP / 2u; half > 0u; half = half >> 1u) {
        if lane < half {
            lows[lane] = min(lows[lane], lows[lane + half]);
        }
        workgroupBarrier();
    }
    return workgroupUniformLoad(&lows[0]);
}
