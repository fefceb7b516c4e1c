// Polar decomposition F = R S, and S = V (I + E) Vᵀ: the rotation closest to F, also for flat and
// inverted tets.
//
// R maximises tr(RᵀF): as a quaternion, it is the eigenvector of the largest eigenvalue of a
// symmetric 4×4 matrix (Davenport; Horn 1987, "Closed-form solution of absolute orientation using
// unit quaternions"), computed by squaring that matrix until it has rank one.

#import lib/finite_elements

struct Polar {
    rotation: mat3x3<f32>,
    // S − I.
    strain: mat3x3<f32>,
}

struct Eigen {
    values: vec3<f32>,
    // Columns.
    vectors: mat3x3<f32>,
}

// Maximum squarings: resolves eigenvalues that differ by 2⁻²² of the largest.
const MATRIX_SQUARINGS: u32 = 24u;

fn closest_rotation(g: mat3x3<f32>) -> vec4<f32> {
    let t = trace(g);
    // Scalar last. tr F is subtracted from the diagonal, which leaves the eigenvectors unchanged.
    let z = vec3(g[1].z - g[2].y, g[2].x - g[0].z, g[0].y - g[1].x);
    let d = 2.0 * vec3(g[0].x, g[1].y, g[2].z) - 2.0 * t - 4.0;
    let xy = g[1].x + g[0].y;
    let xz = g[2].x + g[0].z;
    let yz = g[2].y + g[1].z;
    var k = mat4x4(
        vec4(d.x, xy, xz, z.x),
        vec4(xy, d.y, yz, z.y),
        vec4(xz, yz, d.z, z.z),
        vec4(z, 0.0),
    );
    // Shift that makes all eigenvalues positive: those of the matrix of F are at most √3 |F| in
    // size.
    let f = unit_matrix() + g;
    let shift = 1.7320508 * sqrt(double_dot(f, f)) + 3.0 + t;
    for (var c = 0u; c < 4u; c++) {
        k[c][c] += shift;
    }
    for (var n = 0u; n < MATRIX_SQUARINGS; n++) {
        let size = k[0][0] + k[1][1] + k[2][2] + k[3][3];
        if size <= 0.0 {
            break;
        }
        k = k * (1.0 / size);
        let next = k * k;
        let rest_of_rank = 1.0 - (next[0][0] + next[1][1] + next[2][2] + next[3][3]);
        k = next;
        if rest_of_rank < 1e-6 {
            break;
        }
    }
    // The column of the largest diagonal entry.
    var q = k[0];
    var most = k[0][0];
    for (var c = 1u; c < 4u; c++) {
        if k[c][c] > most {
            most = k[c][c];
            q = k[c];
        }
    }
    let l = length(q);
    if !(l > 0.0) {
        return vec4(0.0, 0.0, 0.0, 1.0);
    }
    return q / l;
}

fn polar(g: mat3x3<f32>) -> Polar {
    let q = closest_rotation(g);
    let v = q.xyz;
    let w = q.w;
    // R − I = 2w [v]× + 2 [v]×²: accurate for small rotations.
    let turn = 2.0 * w * mat3x3(0.0, v.z, -v.y, -v.z, 0.0, v.x, v.y, -v.x, 0.0)
        + 2.0 * (mat3x3(v * v.x, v * v.y, v * v.z) - dot(v, v) * unit_matrix());
    let rotation = unit_matrix() + turn;
    let s = transpose(rotation) * g + transpose(turn);
    // The symmetric part depends on errors of R only to second order.
    return Polar(rotation, 0.5 * (s + transpose(s)));
}

// Applies a Jacobi rotation that makes a_pq zero.
fn jacobi(a: ptr<function, mat3x3<f32>>, v: ptr<function, mat3x3<f32>>, p: u32, q: u32) {
    let apq = (*a)[q][p];
    if apq == 0.0 {
        return;
    }
    let d = (*a)[q][q] - (*a)[p][p];
    let reach = abs(d) + sqrt(d * d + 4.0 * apq * apq);
    let t = select(1.0, -1.0, d < 0.0) * 2.0 * apq / select(1.0, reach, reach > 0.0);
    let c = 1.0 / sqrt(1.0 + t * t);
    let s = t * c;
    let r = 3u - p - q;
    let arp = (*a)[p][r];
    let arq = (*a)[q][r];
    (*a)[p][p] -= t * apq;
    (*a)[q][q] += t * apq;
    (*a)[p][q] = 0.0;
    (*a)[q][p] = 0.0;
    (*a)[p][r] = c * arp - s * arq;
    (*a)[r][p] = (*a)[p][r];
    (*a)[q][r] = s * arp + c * arq;
    (*a)[r][q] = (*a)[q][r];
    let vp = (*v)[p];
    let vq = (*v)[q];
    (*v)[p] = c * vp - s * vq;
    (*v)[q] = s * vp + c * vq;
}

// Returns the eigenvalues and eigenvectors of a symmetric matrix, unsorted.
fn eigen(m: mat3x3<f32>) -> Eigen {
    var a = m;
    var v = unit_matrix();
    for (var sweep = 0u; sweep < 5u; sweep++) {
        jacobi(&a, &v, 0u, 1u);
        jacobi(&a, &v, 0u, 2u);
        jacobi(&a, &v, 1u, 2u);
    }
    return Eigen(vec3(a[0].x, a[1].y, a[2].z), v);
}
