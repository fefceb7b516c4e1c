// Counts particles with non-finite positions, and measures extent and motion: one workgroup, after
// a run of steps.

#import lib/workgroup_sum
#import lib/status

struct GridCheckParams {
    count: u32,
}

struct GridStatus {
    // Number of particles with non-finite positions.
    out_of_range: f32,
    // Sum of m/m̄ |x - x₋₁|².
    motion: f32,
    // Largest squared distance from the centre of the frame.
    reach: f32,
    _pad0: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var previous: texture_2d<f32>;
@group(0) @binding(2) var particles: texture_2d<u32>;
@group(0) @binding(3) var<storage, read_write> status: GridStatus;
@group(0) @binding(4) var<uniform> params: GridCheckParams;

var<workgroup> farthest: array<f32, 256>;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    var sum = vec4(0.0);
    var far = 0.0;
    for (var n = lane; n < params.count; n += WORKGROUP) {
        let particle = textureLoad(particles, array_texel(n), 0);
        let x = textureLoad(positions, array_texel(particle.x), 0).xyz;
        if !finite3(x) {
            sum.x += 1.0;
            continue;
        }
        let d = x - textureLoad(previous, array_texel(particle.x), 0).xyz;
        let inverse = bitcast<f32>(particle.z);
        sum.y += select(0.0, dot(d, d) / inverse, inverse > 0.0);
        far = max(far, dot(x, x));
    }
    let total = reduce(sum, lane);
    farthest[lane] = far;
    workgroupBarrier();
    if lane == 0u {
        for (var i = 1u; i < WORKGROUP; i++) {
            far = max(far, farthest[i]);
        }
        status = GridStatus(total.x, total.y, far, 0u);
    }
}
