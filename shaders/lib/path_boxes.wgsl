// Where a ray outside enters the body: a tree of boxes around the boundary faces, a complete binary
// tree over the faces in their stored order, which is a Morton order. Node i has the children 2i and
// 2i + 1; node 1 is the root. Needs lib/array, `box_at`, `face_at` and `params: Path`.

// Faces per leaf.
const LEAF_FACES: u32 = 4u;

// Returns where a ray (with the reciprocal of its direction) is in a box: from x to y, empty if x > y.
fn box_range(low: vec3<f32>, high: vec3<f32>, o: vec3<f32>, over: vec3<f32>) -> vec2<f32> {
    let a = (low - o) * over;
    let b = (high - o) * over;
    let near = min(a, b);
    let far = max(a, b);
    // Rounding must not part a ray from the face in a flat box.
    let until = min(min(far.x, far.y), far.z) * 1.00001 + 1e-6;
    // An empty leaf has its corners reversed.
    return vec2(max(max(near.x, near.y), near.z), select(-3e38, until, low.x <= high.x));
}

fn reciprocal(d: vec3<f32>) -> vec3<f32> {
    let tiny = select(vec3(-1e-20), vec3(1e-20), d >= vec3(0.0));
    return 1.0 / select(d, tiny, abs(d) < vec3(1e-20));
}

// Returns distance and two barycentric coordinates of a ray's intersection with a triangle (Möller
// and Trumbore 1997), and its determinant, positive from the side where the corners are
// counter-clockwise; a distance of −1 for none.
fn intersect_triangle(p: vec3<f32>, e1: vec3<f32>, e2: vec3<f32>, o: vec3<f32>, d: vec3<f32>) -> vec4<f32> {
    let across = cross(d, e2);
    let det = dot(e1, across);
    if det == 0.0 {
        return vec4(-1.0, 0.0, 0.0, 0.0);
    }
    let from_corner = o - p;
    let u = dot(from_corner, across) / det;
    let second = cross(from_corner, e1);
    let v = dot(d, second) / det;
    let t = dot(e2, second) / det;
    return vec4(select(-1.0, t, u >= 0.0 && v >= 0.0 && u + v <= 1.0), u, v, det);
}

struct FaceHit {
    distance: f32,
    // 4 tet + face, or NONE.
    code: u32,
    // Whether the ray enters the body there.
    front: bool,
}

// Returns the nearest face beyond the distance `after`: of the front faces, or of all.
fn nearest_face(o: vec3<f32>, d: vec3<f32>, after: f32, front_only: bool) -> FaceHit {
    var best = FaceHit(3e38, NONE, true);
    let over = reciprocal(d);
    var i = 1u;
    loop {
        // To the next leaf that the ray meets. A loop of its own, since invocations in lockstep would
        // test faces at every node.
        loop {
            let range = box_range(box_at(2u * i), box_at(2u * i + 1u), o, over);
            if range.x <= range.y && range.y >= after && range.x <= best.distance {
                if i >= params.leaves {
                    break;
                }
                i = 2u * i;
            } else {
                i = next_node(i);
                if i <= 1u {
                    break;
                }
            }
        }
        if i <= 1u && params.leaves > 1u {
            break;
        }
        for (var k = 0u; k < LEAF_FACES; k++) {
            best = nearer_face(best, (i - params.leaves) * LEAF_FACES + k, o, d, after, front_only);
        }
        i = next_node(i);
        if i <= 1u {
            break;
        }
    }
    return best;
}

// Returns the next node in depth-first order, beside or above; 1 or less at the end.
fn next_node(i: u32) -> u32 {
    return (i + 1u) >> countTrailingZeros(i + 1u);
}

// Returns the nearer of `best` and the intersection with face k.
fn nearer_face(best: FaceHit, k: u32, o: vec3<f32>, d: vec3<f32>, after: f32, front_only: bool) -> FaceHit {
    let corner = face_at(3u * k);
    let hit = intersect_triangle(corner.xyz, face_at(3u * k + 1u).xyz, face_at(3u * k + 2u).xyz, o, d);
    if (front_only && hit.w < 0.0) || hit.x < after || hit.x >= best.distance {
        return best;
    }
    return FaceHit(hit.x, bitcast<u32>(corner.w), hit.w > 0.0);
}
