// Finite elements: gathers the element contributions at each node. The passes over tets,
// `physics/tet_forces` and `physics/tet_hessians`, evaluate the constitutive model.
//
// When gathering forces, a row lists the element corners at a node. In the matrix, a row lists the
// edges of a node; without the masses the rows sum to zero: K p = Σ K_ij (p_j − p_i).
#term matter

#import lib/sliced_ellpack

@group(0) @binding(next) var rows: texture_2d<u32>;
@group(0) @binding(next) var columns: texture_2d<u32>;

#for physics/forces
struct ElementParams {
    // Mass-proportional damping coefficient α of the force −α m v.
    drag: f32,
    _pad0: u32,
}

// Force of each corner of each tet; the last component as in `physics/tet_forces`. The last entry
// is zero.
@group(0) @binding(next) var tet_forces: texture_2d<f32>;
@group(0) @binding(next) var<uniform> element_params: ElementParams;

// Returns the force on the node of row t, at position x with velocity v; w is its energy.
fn elements_force(t: u32, m: f32, x: vec3<f32>, v: vec3<f32>) -> vec4<f32> {
    let row = row_of(t);
    var sum = vec4(-element_params.drag * m * v, 0.0);
    for (var q = 0u; q < row.z; q++) {
        let corners = textureLoad(columns, column_texel(row.y, t, q), 0);
        for (var k = 0u; k < 4u; k++) {
            let corner = textureLoad(tet_forces, array_texel(corners[k]), 0);
            let place = corners[k] & 3u;
            sum += vec4(corner.xyz, select(0.0, corner.w, place == 0u));
            inverted_tets += select(0.0, corner.w, place == 1u);
        }
    }
    return sum;
}

#for physics/implicit_euler_begin
// Three texels per directed edge: the rows of (h² + hτ) K_ij.
@group(0) @binding(next) var matrix: texture_2d<f32>;
// Velocities at the start of the step.
@group(0) @binding(next) var step_velocities: texture_2d<f32>;

// Returns the contribution of the elements to a node's system, linearised at position x and
// velocity v.
fn elements_system(t: u32, mass: f32, x: vec3<f32>, v: vec3<f32>, h: f32) -> MaterialContribution {
    let row = row_of(t);
    var share = MaterialContribution(vec3(mass + params.drag * mass), vec3(0.0), vec3(0.0), vec3(0.0));
    for (var q = 0u; q < row.z; q++) {
        let neighbours = textureLoad(columns, column_texel(row.y, t, q), 0);
        for (var k = 0u; k < 4u; k++) {
            if neighbours[k] != row.x {
                let first = 3u * entry_item(row.y, t, q * 4u + k);
                let b0 = textureLoad(matrix, array_texel(first), 0).xyz;
                let b1 = textureLoad(matrix, array_texel(first + 1u), 0).xyz;
                let b2 = textureLoad(matrix, array_texel(first + 2u), 0).xyz;
                share.diagonal -= vec3(b0.x, b1.y, b2.z);
                share.mixed -= 0.5 * (vec3(b0.yz, b1.z) + vec3(b1.x, b2.xy));
            }
        }
    }
    // The residual is M (v₀ − v) + h f(x, v).
    share.ahead = mass * (textureLoad(step_velocities, array_texel(row.x), 0).xyz - v) / (h * h);
    return share;
}

#for physics/implicit_euler_direction
@group(0) @binding(next) var matrix: texture_2d<f32>;

// Returns `so_far` plus the element contribution to the product q = A p at the node of row t.
fn elements_product(t: u32, so_far: vec3<f32>, p: vec3<f32>, beta: f32, first: bool) -> vec3<f32> {
    let row = row_of(t);
    var q = so_far + params.drag * so_far;
    for (var k = 0u; k < row.z; k++) {
        let neighbours = textureLoad(columns, column_texel(row.y, t, k), 0);
        for (var c = 0u; c < 4u; c++) {
            let d = direction_of(array_texel(neighbours[c]), beta, first) - p;
            let block = 3u * entry_item(row.y, t, k * 4u + c);
            q += vec3(
                dot(textureLoad(matrix, array_texel(block), 0).xyz, d),
                dot(textureLoad(matrix, array_texel(block + 1u), 0).xyz, d),
                dot(textureLoad(matrix, array_texel(block + 2u), 0).xyz, d),
            );
        }
    }
    return q;
}
