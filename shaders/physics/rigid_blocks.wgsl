// Computes the diagonal block of each rigid body, Pᵀ A P, and its inverse B on the body's free
// motions. Row i of P is [I, −[a]×] for node i's arm a, in units of the body's radius.
//
// Thirteen texels per body: its rotation at the start of the step; then B, two texels per column,
// with the mean diagonal of the block in w of the first of these.

#import lib/rigid_members
#import lib/cg
#import lib/sliced_ellpack

@group(0) @binding(0) var masses: texture_2d<f32>;
@group(0) @binding(1) var motions: texture_2d<f32>;
@group(0) @binding(2) var rows: texture_2d<u32>;
@group(0) @binding(3) var columns: texture_2d<u32>;
@group(0) @binding(4) var matrix: texture_2d<f32>;
// The second half holds two texels per node: the blocks of nodal terms.
@group(0) @binding(5) var preconditioner: texture_2d<f32>;
@group(0) @binding(6) var<storage, read> choice: array<u32>;
@group(0) @binding(7) var<storage, read> status: Status;
@group(0) @binding(8) var blocks: texture_storage_2d<rgba32float, write>;
@group(0) @binding(9) var<uniform> params: RigidParams;

alias Block = array<array<f32, 6>, 6>;

// Returns the cross product matrix [v]×.
fn cross_matrix(v: vec3<f32>) -> mat3x3<f32> {
    return mat3x3(0.0, v.z, -v.y, -v.z, 0.0, v.x, v.y, -v.x, 0.0);
}

// Cholesky factor of a block, by columns; if the block is not positive definite, its diagonal.
struct Factor {
    lower: Block,
    sound: bool,
}

fn factorise(block: Block) -> Factor {
    var lower = Block();
    var sound = true;
    for (var c = 0u; c < 6u; c++) {
        for (var r = c; r < 6u; r++) {
            var sum = block[c][r];
            for (var k = 0u; k < c; k++) {
                sum -= lower[k][r] * lower[k][c];
            }
            if r == c {
                sound = sound && sum > 1e-7 * block[c][c];
                lower[c][c] = sqrt(max(sum, 1e-37));
            } else {
                lower[c][r] = sum / lower[c][c];
            }
        }
    }
    if !sound {
        for (var c = 0u; c < 6u; c++) {
            lower[c][c] = block[c][c];
        }
    }
    return Factor(lower, sound);
}

// Returns the solution of a factorised block for a right side.
fn solve(factor: Factor, right: array<f32, 6>) -> array<f32, 6> {
    var x = right;
    if !factor.sound {
        for (var r = 0u; r < 6u; r++) {
            x[r] /= factor.lower[r][r];
        }
        return x;
    }
    for (var r = 0u; r < 6u; r++) {
        for (var k = 0u; k < r; k++) {
            x[r] -= factor.lower[k][r] * x[k];
        }
        x[r] /= factor.lower[r][r];
    }
    for (var n = 0u; n < 6u; n++) {
        let r = 5u - n;
        for (var k = r + 1u; k < 6u; k++) {
            x[r] -= factor.lower[r][k] * x[k];
        }
        x[r] /= factor.lower[r][r];
    }
    return x;
}

// Returns Π v.
fn project_vector(v: array<f32, 6>, shifts: f32, turns: mat3x3<f32>) -> array<f32, 6> {
    let turn = turns * vec3(v[3], v[4], v[5]);
    return array<f32, 6>(shifts * v[0], shifts * v[1], shifts * v[2], turn.x, turn.y, turn.z);
}

// Returns Π m Π, the projection to the free motions: Π keeps or removes translations, and projects
// rotations.
fn project_to_freedom(m: Block, shifts: f32, turns: mat3x3<f32>) -> Block {
    var left = Block();
    for (var c = 0u; c < 6u; c++) {
        left[c] = project_vector(m[c], shifts, turns);
    }
    var both = Block();
    for (var r = 0u; r < 6u; r++) {
        let turn = turns * vec3(left[3][r], left[4][r], left[5][r]);
        both[0][r] = shifts * left[0][r];
        both[1][r] = shifts * left[1][r];
        both[2][r] = shifts * left[2][r];
        both[3][r] = turn.x;
        both[4][r] = turn.y;
        both[5][r] = turn.z;
    }
    return both;
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    if status.failed != 0u || status.solving != 0u {
        return;
    }
    for (var b = group.x; b < params.bodies; b += groups.x) {
        let shape = shape_of(b);
        let range = textureLoad(rigid_ranges, array_texel(2u * b), 0);
        var turn = textureLoad(motions, array_texel(6u * b + 1u), 0);
        if choice[0] != 0u {
            turn = quat_normalize(quat_mul(textureLoad(motions, array_texel(6u * b + 2u * choice[0] + 1u), 0), turn));
        }
        // Translational block; rotational block; coupling block.
        var shifts = mat3x3(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        var turns = shifts;
        var mixed = shifts;
        for (var k = lane; k < range.y; k += WORKGROUP) {
            let member = textureLoad(members, array_texel(range.x + k), 0);
            let i = member.x;
            let a = quat_rotate(turn, textureLoad(rigid_arms, array_texel(i), 0).xyz - shape.anchor) / shape.radius;
            let m = (1.0 + params.drag) * textureLoad(masses, array_texel(i), 0).x;
            var own = mat3x3(m, 0.0, 0.0, 0.0, m, 0.0, 0.0, 0.0, m);
            if params.terms != 0u {
                let b0 = textureLoad(preconditioner, array_texel(2u * (params.nodes + i)), 0);
                let b1 = textureLoad(preconditioner, array_texel(2u * (params.nodes + i) + 1u), 0);
                own += sym_matrix(vec3(b0.x, b0.w, b1.y), vec3(b0.yz, b1.x));
            }
            // Response of the node to translations and rotations of its body.
            var by_shift = own;
            var by_turn = own * cross_matrix(-a);
            let row = row_of(member.y);
            for (var q = 0u; q < row.z; q++) {
                let neighbours = textureLoad(columns, column_texel(row.y, member.y, q), 0);
                for (var c = 0u; c < 4u; c++) {
                    if neighbours[c] == i {
                        continue;
                    }
                    let first = 3u * entry_item(row.y, member.y, 4u * q + c);
                    let edge = transpose(mat3x3(
                        textureLoad(matrix, array_texel(first), 0).xyz,
                        textureLoad(matrix, array_texel(first + 1u), 0).xyz,
                        textureLoad(matrix, array_texel(first + 2u), 0).xyz,
                    ));
                    // K_ij (p_j − p_i).
                    let other = textureLoad(rigid_arms, array_texel(neighbours[c]), 0);
                    if u32(other.w) == b + 1u {
                        let apart = quat_rotate(turn, other.xyz - shape.anchor) / shape.radius - a;
                        by_turn += edge * cross_matrix(-apart);
                    } else {
                        by_shift -= edge;
                        by_turn += edge * cross_matrix(a);
                    }
                }
            }
            shifts += by_shift;
            mixed += by_turn;
            turns += cross_matrix(a) * by_turn;
        }
        for (var k = 0u; k < 3u; k++) {
            shifts[k] = reduce(vec4(shifts[k], 0.0), lane).xyz;
            mixed[k] = reduce(vec4(mixed[k], 0.0), lane).xyz;
            turns[k] = reduce(vec4(turns[k], 0.0), lane).xyz;
        }
        // No `continue`, because barriers require uniform control flow.
        if lane == 0u {
            var block = Block();
            for (var c = 0u; c < 3u; c++) {
                for (var r = 0u; r < 3u; r++) {
                    block[c][r] = 0.5 * (shifts[c][r] + shifts[r][c]);
                    block[3u + c][3u + r] = 0.5 * (turns[c][r] + turns[r][c]);
                    block[3u + c][r] = mixed[c][r];
                    block[r][3u + c] = mixed[c][r];
                }
            }
            let axis = quat_rotate(turn, shape.axis);
            var keep = mat3x3(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
            if shape.freedom == HINGE {
                keep = mat3x3(axis * axis.x, axis * axis.y, axis * axis.z);
            }
            let free = select(0.0, 1.0, shape.freedom == FREE);
            block = project_to_freedom(block, free, keep);
            var scale = 1e-37;
            var sum = 0.0;
            for (var k = 0u; k < 6u; k++) {
                scale = max(scale, block[k][k]);
                sum += block[k][k];
            }
            // Replaces constrained motions by a regular diagonal.
            for (var c = 0u; c < 3u; c++) {
                block[c][c] += scale * (1.0 - free);
                for (var r = 0u; r < 3u; r++) {
                    block[3u + c][3u + r] += scale * (select(0.0, 1.0, r == c) - keep[c][r]);
                }
            }
            let factor = factorise(block);
            textureStore(blocks, array_texel(13u * b), turn);
            // Column by column: the whole of Π B Π would take 36 registers of a GPU.
            for (var c = 0u; c < 6u; c++) {
                var unit = array<f32, 6>();
                unit[c] = 1.0;
                let column = project_vector(solve(factor, project_vector(unit, free, keep)), free, keep);
                textureStore(blocks, array_texel(13u * b + 1u + 2u * c), vec4(column[0], column[1], column[2], sum / 6.0));
                textureStore(blocks, array_texel(13u * b + 2u + 2u * c), vec4(column[3], column[4], column[5], 0.0));
            }
        }
    }
}
