// Assembles tool contact at the boundary nodes, including points inside the adjacent faces: three
// texels per node. The force, with the number of points that penetrate too deeply in w; and the row
// sum of the node's matrix blocks, as xx xy xz yy, yz zz.

#import lib/contact_forces

// For each boundary node: its number, its first face in `around`, the number of its faces, A K.
@group(0) @binding(next) var boundary_nodes: texture_2d<u32>;
// Three times the number of the face, plus the corner of the face that is the node.
@group(0) @binding(next) var around_nodes: texture_2d<u32>;
@group(0) @binding(next) var faces: texture_2d<f32>;
@group(0) @binding(next) var node_contributions: texture_storage_2d<rgba32float, write>;

struct ContactPoint {
    node: vec2<u32>,
}

fn start_offset(at: ContactPoint, origin: vec3<f32>) -> vec3<f32> {
    return textureLoad(start_positions, at.node, 0).xyz - origin;
}

fn velocity_at(at: ContactPoint) -> vec3<f32> {
    return textureLoad(velocities, at.node, 0).xyz;
}

fn velocity_change_at(at: ContactPoint) -> vec3<f32> {
    return textureLoad(direction, at.node, 0).xyz;
}

fn friction_velocity_at(at: ContactPoint) -> vec3<f32> {
    return textureLoad(lagged_velocities, at.node, 0).xyz;
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let n = invocation_index(id, groups);
    if n >= params.items || status.failed != 0u || status.solving != 0u {
        return;
    }
    let node = textureLoad(boundary_nodes, array_texel(n), 0);
    let i = array_texel(node.x);
    var force = vec4(0.0);
    var b0 = vec4(0.0);
    var b1 = vec4(0.0);
    if textureLoad(masses, i, 0).y != 0.0 {
        let at = ContactPoint(i);
        for (var k = 0u; k < arrayLength(&tools); k++) {
            let contribution = contact_contribution(k, at, bitcast<f32>(node.w));
            force += vec4(contribution.force, contribution.exceeds_penetration);
            b0 += vec4(contribution.diagonal.x, contribution.mixed.xy, contribution.diagonal.y);
            b1 += vec4(contribution.mixed.z, contribution.diagonal.z, 0.0, 0.0);
        }
    }
    for (var f = node.y; f < node.y + node.z; f++) {
        let face = textureLoad(around_nodes, array_texel(f), 0).x;
        let first = 15u * (face / 3u);
        let corner = face % 3u;
        if textureLoad(faces, array_texel(first + 2u), 0).w == 0.0 {
            continue;
        }
        let face_force = textureLoad(faces, array_texel(first + corner), 0);
        force += vec4(face_force.xyz, select(0.0, face_force.w, corner == 0u));
        // With itself, with the next corner, and with the previous one.
        for (var k = 0u; k < 3u; k++) {
            let block = select(3u + (corner + 2u * (k - 1u)) % 3u, corner, k == 0u);
            b0 += textureLoad(faces, array_texel(first + 3u + 2u * block), 0);
            b1 += textureLoad(faces, array_texel(first + 4u + 2u * block), 0);
        }
    }
    textureStore(node_contributions, array_texel(3u * node.x), force);
    textureStore(node_contributions, array_texel(3u * node.x + 1u), b0);
    textureStore(node_contributions, array_texel(3u * node.x + 2u), b1);
}
