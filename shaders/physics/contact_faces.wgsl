// Tool contact at points inside the boundary faces: 15 texels per face. The force on each of its
// nodes; w of the first counts the points that penetrate too deeply, w of the last the points in
// contact. Then the matrix blocks of each node with itself, the first with the second, the second
// with the third, and the third with the first, each as xx xy xz yy, yz zz.

#import lib/contact_forces

// Nodes of each face; w is the longest edge at rest.
@group(0) @binding(next) var contact_corners: texture_2d<u32>;
// A K of each face.
@group(0) @binding(next) var face_weights: texture_2d<f32>;
@group(0) @binding(next) var faces: texture_storage_2d<rgba32float, write>;

fn add(to: ptr<function, array<vec4<f32>, 15>>, k: u32, by: f32, share: ContactContribution) {
    (*to)[3u + 2u * k] += by * vec4(share.diagonal.x, share.mixed.xy, share.diagonal.y);
    (*to)[4u + 2u * k] += by * vec4(share.mixed.z, share.diagonal.z, 0.0, 0.0);
}

// Returns an upper bound of the motion of tool k relative to a given pose, at distance `arm` from
// its origin.
fn tool_displacement(k: u32, place: vec4<f32>, turn: vec4<f32>, arm: f32) -> f32 {
    let moved = distance(tools[k].current_position.xyz, place.xyz);
    return moved + 4.0 * length(tools[k].current_rotation - turn) * (arm + moved);
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let n = invocation_index(id, groups);
    if n >= params.items || status.failed != 0u || status.solving != 0u {
        return;
    }
    let face = textureLoad(contact_corners, array_texel(n), 0);
    let longest = bitcast<f32>(face.w);
    var nodes: ContactNodes;
    var free = vec3(0.0);
    for (var c = 0u; c < 3u; c++) {
        let i = array_texel(face[c]);
        nodes.x[c] = textureLoad(start_positions, i, 0).xyz;
        nodes.v[c] = textureLoad(velocities, i, 0).xyz;
        nodes.way[c] = textureLoad(ways, i, 0).xyz;
        nodes.rubbed[c] = textureLoad(rubbed, i, 0).xyz;
        free[c] = select(0.0, 1.0, textureLoad(masses, i, 0).y != 0.0);
    }
    let third = vec3(1.0 / 3.0);
    let moved = nodes.x + params.dt * nodes.v;
    var reach = max(max(distance(moved[0], moved[1]), distance(moved[1], moved[2])), distance(moved[2], moved[0]));
    for (var c = 0u; c < 3u; c++) {
        // Also considers the friction velocities and the previous iteration.
        let off = max(length(nodes.v[c] - nodes.rubbed[c]), length(nodes.way[c]));
        reach = max(reach, distance(moved[c], moved[(c + 1u) % 3u]) + params.dt * off);
    }
    var sums: array<vec4<f32>, 15>;
    var touching = 0.0;
    for (var k = 0u; k < arrayLength(&tools); k++) {
        let parts = subdivisions(k, longest);
        // A face is never closer to a plane than its nodes.
        if parts < 2u || u32(tools[k].shape.w) == PLANE {
            continue;
        }
        let middle = relative_displacement(nodes.x, tools[k].current_position.xyz, third, params.dt * (nodes.v * third));
        let drawn = max(tool_displacement(k, tools[k].friction_position, tools[k].friction_rotation, length(middle)),
            tool_displacement(k, tools[k].previous_position, tools[k].previous_rotation, length(middle)));
        if surface_distance(k, middle, tools[k].current_rotation).w >= active_gap(k) + reach + drawn {
            continue;
        }
        let ak = textureLoad(face_weights, array_texel(n), 0).x / (0.5 * f32((parts + 1u) * (parts + 2u)) - 3.0);
        for (var i = 0u; i <= parts; i++) {
            for (var j = 0u; j <= parts - i; j++) {
                let l = parts - i - j;
                let w = vec3(f32(i), f32(j), f32(l)) / f32(parts);
                if max(max(i, j), l) == parts || dot(w, free) < MIN_MOBILITY {
                    continue;
                }
                let share = contact_contribution(k, nodes, w, ak);
                sums[0].w += share.pierced;
                if !share.touches {
                    continue;
                }
                touching += 1.0;
                for (var c = 0u; c < 3u; c++) {
                    sums[c] += vec4(w[c] * share.force, 0.0);
                    add(&sums, c, w[c] * w[c], share);
                    add(&sums, 3u + c, w[c] * w[(c + 1u) % 3u], share);
                }
            }
        }
    }
    sums[2].w = touching;
    // Without contact, the remaining texels are never read.
    let count = select(3u, 15u, touching > 0.0);
    for (var t = 0u; t < count; t++) {
        textureStore(faces, array_texel(15u * n + t), sums[t]);
    }
}
