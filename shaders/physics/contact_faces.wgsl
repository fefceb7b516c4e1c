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

fn add(to: ptr<function, array<vec4<f32>, 15>>, k: u32, weight: f32, contribution: ContactContribution) {
    (*to)[3u + 2u * k] += weight * vec4(contribution.diagonal.x, contribution.mixed.xy, contribution.diagonal.y);
    (*to)[4u + 2u * k] += weight * vec4(contribution.mixed.z, contribution.diagonal.z, 0.0, 0.0);
}

// Returns an upper bound of the motion of tool k relative to a given pose, at distance `arm` from
// its origin.
fn tool_displacement(k: u32, position: vec4<f32>, rotation: vec4<f32>, arm: f32) -> f32 {
    let moved = distance(tools[k].current_position.xyz, position.xyz);
    return moved + 4.0 * length(tools[k].current_rotation - rotation) * (arm + moved);
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
        nodes.velocity_change[c] = textureLoad(direction, i, 0).xyz;
        nodes.friction_velocities[c] = textureLoad(friction_velocities, i, 0).xyz;
        free[c] = select(0.0, 1.0, textureLoad(masses, i, 0).y != 0.0);
    }
    let third = vec3(1.0 / 3.0);
    let moved = nodes.x + params.dt * nodes.v;
    var reach = max(max(distance(moved[0], moved[1]), distance(moved[1], moved[2])), distance(moved[2], moved[0]));
    for (var c = 0u; c < 3u; c++) {
        // Also considers the friction velocities and the previous iteration.
        let max_change = max(length(nodes.v[c] - nodes.friction_velocities[c]), length(nodes.velocity_change[c]));
        reach = max(reach, distance(moved[c], moved[(c + 1u) % 3u]) + params.dt * max_change);
    }
    var sums: array<vec4<f32>, 15>;
    var touching_points = 0.0;
    for (var k = 0u; k < arrayLength(&tools); k++) {
        let divisions = subdivisions(k, longest);
        // A face is never closer to a plane than its nodes.
        if divisions < 2u || u32(tools[k].dimensions.w) == PLANE {
            continue;
        }
        let centroid = relative_displacement(nodes.x, tools[k].current_position.xyz, third, params.dt * (nodes.v * third));
        let tool_motion = max(tool_displacement(k, tools[k].friction_position, tools[k].friction_rotation, length(centroid)),
            tool_displacement(k, tools[k].previous_position, tools[k].previous_rotation, length(centroid)));
        if surface_distance(k, centroid, tools[k].current_rotation).w >= active_gap(k) + reach + tool_motion {
            continue;
        }
        let ak = textureLoad(face_weights, array_texel(n), 0).x / (0.5 * f32((divisions + 1u) * (divisions + 2u)) - 3.0);
        for (var i = 0u; i <= divisions; i++) {
            for (var j = 0u; j <= divisions - i; j++) {
                let l = divisions - i - j;
                let w = vec3(f32(i), f32(j), f32(l)) / f32(divisions);
                if max(max(i, j), l) == divisions || dot(w, free) < MIN_MOBILITY {
                    continue;
                }
                let contribution = contact_contribution(k, nodes, w, ak);
                sums[0].w += contribution.exceeds_penetration;
                if !contribution.touches {
                    continue;
                }
                touching_points += 1.0;
                for (var c = 0u; c < 3u; c++) {
                    sums[c] += vec4(w[c] * contribution.force, 0.0);
                    add(&sums, c, w[c] * w[c], contribution);
                    add(&sums, 3u + c, w[c] * w[(c + 1u) % 3u], contribution);
                }
            }
        }
    }
    sums[2].w = touching_points;
    // Without contact, the remaining texels are never read.
    let count = select(3u, 15u, touching_points > 0.0);
    for (var t = 0u; t < count; t++) {
        textureStore(faces, array_texel(15u * n + t), sums[t]);
    }
}
