// Springs between nodes (equations 2 to 5 of Tejada & Ertl). CPU reference:
// `physics::reference::springs`.
//
// K̃ is the Jacobian with the transverse term clamped: K̃_ij = κ((1−t) x̂x̂ᵀ + t I), t = max(1 −
// L/|x|, 0). The matrix block of each spring is stored as u uᵀ + b I.
#term matter

#import lib/sliced_ellpack

@group(0) @binding(next) var rows: texture_2d<u32>;
@group(0) @binding(next) var columns: texture_2d<u32>;

#for physics/forces physics/implicit_euler_begin
struct SpringParams {
    // κ_d = damping + damping_time · κ, applied along the spring's axis or to the whole relative
    // velocity.
    damping: f32,
    damping_time: f32,
    axial: u32,
    _pad0: u32,
}

// κ and L of each directed spring.
@group(0) @binding(next) var springs: texture_2d<f32>;
@group(0) @binding(next) var<uniform> spring_params: SpringParams;

// Returns the unit vector along d, whose length is l; zero for coincident nodes.
fn spring_extension(d: vec3<f32>, l: f32) -> vec3<f32> {
    return d * select(0.0, 1.0 / l, l > 0.0);
}

#for physics/forces
// Returns the force on the node of row t, at position x with velocity v; w is its energy.
fn springs_force(t: u32, m: f32, x: vec3<f32>, v: vec3<f32>) -> vec4<f32> {
    let row = row_of(t);
    var f = vec3(0.0);
    var elastic = 0.0;
    for (var q = 0u; q < row.z; q++) {
        let neighbours = textureLoad(columns, column_texel(row.y, t, q), 0);
        for (var k = 0u; k < 4u; k++) {
            let j = array_texel(neighbours[k]);
            let spring = textureLoad(springs, entry_texel(row.y, t, q * 4u + k), 0);
            let d = textureLoad(positions, j, 0).xyz - x;
            let w = textureLoad(velocities, j, 0).xyz - v;
            let l = length(d);
            let n = spring_extension(d, l);
            let stretch = l - spring.y;
            let damping = spring_params.damping + spring_params.damping_time * spring.x;
            let braked = select(w, n * dot(n, w), spring_params.axial != 0u);
            f += spring.x * stretch * n + damping * braked;
            elastic += spring.x * stretch * stretch;
        }
    }
    // Each spring is visited from both ends, so each end receives half of its energy.
    return vec4(f, 0.25 * elastic);
}

#for physics/implicit_euler_begin
// u and b of each directed spring.
@group(0) @binding(next) var edges: texture_storage_2d<rgba32float, write>;

// Returns the contribution of the springs to a node's system for a step of length h.
fn springs_system(t: u32, mass: f32, x: vec3<f32>, v: vec3<f32>, h: f32) -> MaterialContribution {
    let row = row_of(t);
    var share = MaterialContribution(vec3(mass), vec3(0.0), vec3(0.0), v);
    for (var q = 0u; q < row.z; q++) {
        let neighbours = textureLoad(columns, column_texel(row.y, t, q), 0);
        for (var k = 0u; k < 4u; k++) {
            let j = neighbours[k];
            let place = entry_texel(row.y, t, q * 4u + k);
            let spring = textureLoad(springs, place, 0);
            let d = textureLoad(positions, array_texel(j), 0).xyz - x;
            let w = textureLoad(velocities, array_texel(j), 0).xyz - v;
            let l = length(d);
            let n = spring_extension(d, l);
            // A spring with a rest length and coincident ends has no direction and no transverse
            // term.
            let s = select(select(0.0, 1.0, spring.y == 0.0), max(1.0 - spring.y / l, 0.0), l > 0.0);
            share.ahead += spring.x * ((1.0 - s) * n * dot(n, w) + s * w);
            let damping = select(
                spring_params.damping + spring_params.damping_time * spring.x,
                0.0,
                j == row.x,
            );
            let axial = select(0.0, h * damping, spring_params.axial != 0u);
            let u = sqrt(h * h * spring.x * (1.0 - s) + axial) * n;
            let b = h * h * spring.x * s + (h * damping - axial);
            textureStore(edges, place, vec4(u, b));
            share.diagonal += u * u + b;
            share.mixed += u.xxy * u.yzz;
        }
    }
    return share;
}

#for physics/implicit_euler_direction
@group(0) @binding(next) var edges: texture_2d<f32>;

// Returns `so_far` plus the spring contribution to the product q = A p at the node of row t.
fn springs_product(t: u32, so_far: vec3<f32>, p: vec3<f32>, beta: f32, first: bool) -> vec3<f32> {
    let row = row_of(t);
    var q = so_far;
    for (var k = 0u; k < row.z; k++) {
        let neighbours = textureLoad(columns, column_texel(row.y, t, k), 0);
        for (var c = 0u; c < 4u; c++) {
            let j = array_texel(neighbours[c]);
            let edge = textureLoad(edges, entry_texel(row.y, t, k * 4u + c), 0);
            var d = p - textureLoad(preconditioned, j, 0).xyz;
            if !first {
                d -= beta * textureLoad(direction, j, 0).xyz;
            }
            q += edge.xyz * dot(edge.xyz, d) + edge.w * d;
        }
    }
    return q;
}
