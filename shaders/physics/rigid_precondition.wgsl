// Projects conjugate gradients to rigid motions: z = P B Pᵀ r at the nodes of rigid bodies, after
// each residual, in place of the nodal preconditioner. All directions are combinations of such z,
// so this is conjugate gradients on Pᵀ A P without forming that matrix.

#import lib/rigid_members
#import lib/cg

@group(0) @binding(0) var residual: texture_2d<f32>;
@group(0) @binding(1) var blocks: texture_2d<f32>;
@group(0) @binding(2) var<storage, read> status: Status;
@group(0) @binding(3) var<storage, read> before: CgScalars;
@group(0) @binding(4) var<storage, read> after: CgScalars;
@group(0) @binding(5) var preconditioned: texture_storage_2d<rgba32float, write>;
// After those of all nodes: r·z and mean diagonal entries per workgroup.
@group(0) @binding(6) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(7) var<uniform> params: RigidParams;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    if status.failed != 0u {
        return;
    }
    if params.first != 0u {
        if status.solving != 0u {
            return;
        }
    } else if after.iterations == before.iterations {
        // The first half did nothing, so this pass does nothing either.
        return;
    }
    var total = vec4(0.0);
    for (var b = group.x; b < params.bodies; b += groups.x) {
        let shape = shape_of(b);
        let range = textureLoad(rigid_ranges, array_texel(2u * b), 0);
        let turn = textureLoad(blocks, array_texel(13u * b), 0);
        let over = 1.0 / shape.radius;
        var force = vec3(0.0);
        var moment = vec3(0.0);
        for (var k = lane; k < range.y; k += WORKGROUP) {
            let i = textureLoad(members, array_texel(range.x + k), 0).x;
            let a = over * quat_rotate(turn, textureLoad(rigid_arms, array_texel(i), 0).xyz - shape.anchor);
            let r = textureLoad(residual, array_texel(i), 0).xyz;
            force += r;
            moment += cross(a, r);
        }
        force = reduce(vec4(force, 0.0), lane).xyz;
        moment = reduce(vec4(moment, 0.0), lane).xyz;
        var shift = vec3(0.0);
        var spin = vec3(0.0);
        for (var c = 0u; c < 3u; c++) {
            shift += force[c] * textureLoad(blocks, array_texel(13u * b + 1u + 2u * c), 0).xyz;
            spin += force[c] * textureLoad(blocks, array_texel(13u * b + 2u + 2u * c), 0).xyz;
            shift += moment[c] * textureLoad(blocks, array_texel(13u * b + 7u + 2u * c), 0).xyz;
            spin += moment[c] * textureLoad(blocks, array_texel(13u * b + 8u + 2u * c), 0).xyz;
        }
        if shape.freedom == FIXED {
            shift = vec3(0.0);
            spin = vec3(0.0);
        }
        let weight = textureLoad(blocks, array_texel(13u * b + 1u), 0).w;
        total += vec4(dot(force, shift) + dot(moment, spin), select(weight, 0.0, shape.freedom == FIXED), 0.0, 0.0);
        for (var k = lane; k < range.y; k += WORKGROUP) {
            let i = textureLoad(members, array_texel(range.x + k), 0).x;
            let a = over * quat_rotate(turn, textureLoad(rigid_arms, array_texel(i), 0).xyz - shape.anchor);
            textureStore(preconditioned, array_texel(i), vec4(shift + cross(spin, a), 0.0));
        }
    }
    if lane == 0u {
        partials[params.groups + group.x] = total;
    }
}
