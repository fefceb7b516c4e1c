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

// Sum of matrix blocks: xx, yy, zz, and xy, xz, yz.
struct Block {
    diagonal: vec3<f32>,
    mixed: vec3<f32>,
}

// Sums over the points of a face: the force on each node; the blocks of each with itself, and with
// the next. They take 47 registers of a GPU, and the contact of a point most of the others; so
// everything else is read again at each point.
struct FaceSums {
    forces: mat3x3<f32>,
    own_a: Block,
    own_b: Block,
    own_c: Block,
    next_a: Block,
    next_b: Block,
    next_c: Block,
    // Number of points that penetrate too deeply, and of points in contact.
    deep: f32,
    touching: f32,
}

var<private> sums: FaceSums;

fn plus(sum: Block, weight: f32, contribution: ContactContribution) -> Block {
    return Block(sum.diagonal + weight * contribution.diagonal, sum.mixed + weight * contribution.mixed);
}

fn store(first: u32, block: Block) {
    textureStore(faces, array_texel(first), vec4(block.diagonal.x, block.mixed.xy, block.diagonal.y));
    textureStore(faces, array_texel(first + 1u), vec4(block.mixed.z, block.diagonal.z, 0.0, 0.0));
}

// Returns an upper bound of the motion of tool k relative to a given pose, at distance `arm` from
// its origin.
fn tool_displacement(k: u32, position: vec4<f32>, rotation: vec4<f32>, arm: f32) -> f32 {
    let moved = distance(tools[k].current_position.xyz, position.xyz);
    return moved + 4.0 * length(tools[k].current_rotation - rotation) * (arm + moved);
}

fn velocities_of(nodes: vec4<u32>) -> mat3x3<f32> {
    return mat3x3(
        textureLoad(velocities, array_texel(nodes.x), 0).xyz,
        textureLoad(velocities, array_texel(nodes.y), 0).xyz,
        textureLoad(velocities, array_texel(nodes.z), 0).xyz,
    );
}

fn velocity_changes_of(nodes: vec4<u32>) -> mat3x3<f32> {
    return mat3x3(
        textureLoad(direction, array_texel(nodes.x), 0).xyz,
        textureLoad(direction, array_texel(nodes.y), 0).xyz,
        textureLoad(direction, array_texel(nodes.z), 0).xyz,
    );
}

fn friction_velocities_of(nodes: vec4<u32>) -> mat3x3<f32> {
    return mat3x3(
        textureLoad(lagged_velocities, array_texel(nodes.x), 0).xyz,
        textureLoad(lagged_velocities, array_texel(nodes.y), 0).xyz,
        textureLoad(lagged_velocities, array_texel(nodes.z), 0).xyz,
    );
}

// Returns 1 for nodes that can move, 0 for others.
fn mobilities(nodes: vec4<u32>) -> vec3<f32> {
    let inverse = vec3(
        textureLoad(masses, array_texel(nodes.x), 0).y,
        textureLoad(masses, array_texel(nodes.y), 0).y,
        textureLoad(masses, array_texel(nodes.z), 0).y,
    );
    return select(vec3(0.0), vec3(1.0), inverse != vec3(0.0));
}

// Returns an upper bound of the distance between the centroid of a face and any of its points,
// now, in the previous iteration and in the friction state.
fn reach_of(nodes: vec4<u32>) -> f32 {
    let v = velocities_of(nodes);
    let moved = mat3x3(
        textureLoad(start_positions, array_texel(nodes.x), 0).xyz,
        textureLoad(start_positions, array_texel(nodes.y), 0).xyz,
        textureLoad(start_positions, array_texel(nodes.z), 0).xyz,
    ) + params.dt * v;
    let change = velocity_changes_of(nodes);
    let friction_change = v - friction_velocities_of(nodes);
    var reach = max(max(distance(moved[0], moved[1]), distance(moved[1], moved[2])), distance(moved[2], moved[0]));
    for (var c = 0u; c < 3u; c++) {
        let max_change = max(length(friction_change[c]), length(change[c]));
        reach = max(reach, distance(moved[c], moved[(c + 1u) % 3u]) + params.dt * max_change);
    }
    return reach;
}

struct ContactPoint {
    // Nodes of the face, and their weights.
    nodes: vec4<u32>,
    w: vec3<f32>,
}

fn start_offset(at: ContactPoint, origin: vec3<f32>) -> vec3<f32> {
    return at.w.x * (textureLoad(start_positions, array_texel(at.nodes.x), 0).xyz - origin)
        + at.w.y * (textureLoad(start_positions, array_texel(at.nodes.y), 0).xyz - origin)
        + at.w.z * (textureLoad(start_positions, array_texel(at.nodes.z), 0).xyz - origin);
}

fn velocity_at(at: ContactPoint) -> vec3<f32> {
    return velocities_of(at.nodes) * at.w;
}

fn velocity_change_at(at: ContactPoint) -> vec3<f32> {
    return velocity_changes_of(at.nodes) * at.w;
}

fn friction_velocity_at(at: ContactPoint) -> vec3<f32> {
    return friction_velocities_of(at.nodes) * at.w;
}

// Whether tool k may touch a face between its nodes.
fn is_near(k: u32, nodes: vec4<u32>, reach: f32) -> bool {
    let centroid = ContactPoint(nodes, vec3(1.0 / 3.0));
    let p = start_offset(centroid, tools[k].current_position.xyz) + params.dt * velocity_at(centroid);
    let tool_motion = max(tool_displacement(k, tools[k].friction_position, tools[k].friction_rotation, length(p)),
        tool_displacement(k, tools[k].previous_position, tools[k].previous_rotation, length(p)));
    return surface_distance(k, p, tools[k].current_rotation).w < active_gap(k) + reach + tool_motion;
}

// Adds the contact of tool k with the points of face n, whose edges it divides.
fn add_tool(k: u32, n: u32, nodes: vec4<u32>, divisions: u32) {
    let ak = textureLoad(face_weights, array_texel(n), 0).x / (0.5 * f32((divisions + 1u) * (divisions + 2u)) - 3.0);
    for (var i = 0u; i <= divisions; i++) {
        for (var j = 0u; j <= divisions - i; j++) {
            let l = divisions - i - j;
            let w = vec3(f32(i), f32(j), f32(l)) / f32(divisions);
            if max(max(i, j), l) == divisions || dot(w, mobilities(nodes)) < MIN_MOBILITY {
                continue;
            }
            let contribution = contact_contribution(k, ContactPoint(nodes, w), ak);
            sums.deep += contribution.exceeds_penetration;
            if !contribution.touches {
                continue;
            }
            sums.touching += 1.0;
            for (var c = 0u; c < 3u; c++) {
                sums.forces[c] += w[c] * contribution.force;
            }
            sums.own_a = plus(sums.own_a, w.x * w.x, contribution);
            sums.own_b = plus(sums.own_b, w.y * w.y, contribution);
            sums.own_c = plus(sums.own_c, w.z * w.z, contribution);
            sums.next_a = plus(sums.next_a, w.x * w.y, contribution);
            sums.next_b = plus(sums.next_b, w.y * w.z, contribution);
            sums.next_c = plus(sums.next_c, w.z * w.x, contribution);
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let n = invocation_index(id, groups);
    if n >= params.items || status.failed != 0u || status.solving != 0u {
        return;
    }
    let nodes = textureLoad(contact_corners, array_texel(n), 0);
    sums = FaceSums();
    var reach = -1.0;
    for (var k = 0u; k < arrayLength(&tools); k++) {
        let divisions = subdivisions(k, bitcast<f32>(nodes.w));
        // By itself, because a compiler would keep what `is_near` reads for the points.
        var near = false;
        // A face is never closer to a plane than its nodes.
        if divisions >= 2u && u32(tools[k].dimensions.w) != PLANE {
            if reach < 0.0 {
                reach = reach_of(nodes);
            }
            near = is_near(k, nodes, reach);
        }
        if near {
            add_tool(k, n, nodes, divisions);
        }
    }
    let first = 15u * n;
    textureStore(faces, array_texel(first), vec4(sums.forces[0], sums.deep));
    textureStore(faces, array_texel(first + 1u), vec4(sums.forces[1], 0.0));
    textureStore(faces, array_texel(first + 2u), vec4(sums.forces[2], sums.touching));
    // Without contact, the remaining texels are never read.
    if sums.touching > 0.0 {
        store(first + 3u, sums.own_a);
        store(first + 5u, sums.own_b);
        store(first + 7u, sums.own_c);
        store(first + 9u, sums.next_a);
        store(first + 11u, sums.next_b);
        store(first + 13u, sums.next_c);
    }
}
