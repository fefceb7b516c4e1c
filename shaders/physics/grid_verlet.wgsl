// One Verlet step on a grid of particles with implicit connectivity: forces of the 18 neighbours,
// the next position, and optionally the approximate normal, in one pass (Mosegaard, Herborg &
// Sørensen 2005, section 2.3). CPU reference: `physics::grid::reference`.

#import lib/array
#import lib/normals

// Whether normals are written; whether the external forces are read.
override NORMALS: bool = false;
override EXTERNAL: bool = false;

struct GridParams {
    // For each kind of spring: the offset of the neighbour's number (bits of an i32), the rest
    // length in local units, h² κ / m of the mean particle.
    springs: array<vec4<f32>, 9>,
    // h² g in local units; w: h² / (m L), from newtons to local units.
    pull: vec4<f32>,
    count: u32,
    // (1 - γh/2) / (1 + γh/2) and 1 / (1 + γh/2), γ the damping rate.
    damping_factor: f32,
    acceleration_scale: f32,
    // Normals shorter than this are treated as missing.
    least_normal: f32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var previous: texture_2d<f32>;
// Number, springs (bit 2k forward along kind k, 2k + 1 backward), inverse mass relative to the mean
// particle.
@group(0) @binding(2) var particles: texture_2d<u32>;
@group(0) @binding(3) var external_forces: texture_2d<f32>;
@group(0) @binding(4) var next: texture_storage_2d<rgba32float, write>;
@group(0) @binding(5) var normals: texture_storage_2d<r32uint, write>;
@group(0) @binding(6) var<uniform> params: GridParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let n = invocation_index(id, groups);
    if n >= params.count {
        return;
    }
    let particle = textureLoad(particles, array_texel(n), 0);
    let i = particle.x;
    let springs = particle.y;
    let here = textureLoad(positions, array_texel(i), 0);
    let x = here.xyz;
    // w is the particle's stiffness relative to the body's; a spring uses the mean of its ends.
    let k = here.w;
    var f = vec3(0.0);
    var normal = vec3(0.0);
    for (var kind = 0u; kind < 9u; kind++) {
        let spring = params.springs[kind];
        let step = bitcast<u32>(spring.x);
        // Missing neighbours and cut springs have the factor 0.
        let there = vec2<f32>((vec2(springs) >> vec2(2u * kind, 2u * kind + 1u)) & vec2(1u));
        let ahead = textureLoad(positions, array_texel(i + step), 0);
        let behind = textureLoad(positions, array_texel(i - step), 0);
        let d = ahead.xyz - x;
        let e = behind.xyz - x;
        let l2 = vec2(dot(d, d), dot(e, e));
        let over = select(vec2(0.0), inverseSqrt(l2), l2 > vec2(0.0)) * there;
        let pull = (0.5 * spring.z) * (vec2(k) + vec2(ahead.w, behind.w)) * (there - spring.y * over);
        f += pull.x * d + pull.y * e;
        if NORMALS {
            normal -= over.x * d + over.y * e;
        }
    }
    let inverse_mass = bitcast<f32>(particle.z);
    var move_ = inverse_mass * f + params.pull.xyz;
    if EXTERNAL {
        move_ += inverse_mass * params.pull.w * textureLoad(external_forces, array_texel(i), 0).xyz;
    }
    let before = textureLoad(previous, array_texel(i), 0).xyz;
    let step = params.damping_factor * (x - before) + params.acceleration_scale * move_;
    // A pinned particle has zero inverse mass.
    textureStore(next, array_texel(i), vec4(x + select(vec3(0.0), step, inverse_mass != 0.0), k));
    if NORMALS {
        let long = dot(normal, normal) >= params.least_normal * params.least_normal;
        textureStore(normals, array_texel(i), vec4(select(NO_NORMAL, pack_normal(normal), long), 0u, 0u, 0u));
    }
}
