// The walk over projected vertices: three vertices of the face just crossed are carried along in
// camera space, seen along the ray; each step fetches the fourth of the next tet, whose id follows
// by exclusive or, and two sign tests tell which face the ray leaves through. After Aman et al.,
// "Compact tetrahedralization-based acceleration structures for ray tracing" (2022).
//
// The ray is the origin of a plane: vertex (x, y, z) is seen at (x, y) - origin - slope z, and the
// weights of a point in face ABC are the areas (B × C, C × A, A × B) over their sum.

#import lib/array
#import lib/view
#import lib/tet
#import lib/segment
#import lib/sight

// Towards the eye, from back faces in front of an eye that is inside the mesh.
override BACKWARDS: bool = false;
// Whether something opaque may end the rays.
override OCCLUDED: bool = false;
// Whether scalars are constant in each tet.
override CELLS: bool = false;

@group(0) @binding(0) var projected: texture_2d<f32>;
// The four nodes of each tet.
@group(0) @binding(1) var tets: texture_2d<u32>;
// Across the face opposite the k-th smallest node of tet t, at 4 t + k: the neighbour, and the
// exclusive or of its nodes.
@group(0) @binding(2) var links: texture_2d<u32>;
// One scalar a tet, if CELLS.
@group(0) @binding(3) var cells: texture_2d<f32>;
// The gradient at each node, if LIT.
@group(0) @binding(4) var gradients: texture_2d<f32>;
// Depth bits and 4 tet + face where the rays of this layer start.
@group(0) @binding(5) var starts: texture_2d<u32>;
// The nearest front faces, which tell a backward walk whether the eye is inside.
@group(0) @binding(6) var fronts: texture_2d<u32>;
// What the layers before gathered.
@group(0) @binding(7) var gathered: texture_2d<f32>;
@group(0) @binding(8) var occluder: texture_depth_2d;
@group(0) @binding(9) var table: texture_2d_array<f32>;
@group(0) @binding(10) var smooth_sampler: sampler;
@group(0) @binding(11) var<storage, read_write> lost: array<atomic<u32>, 1>;
@group(0) @binding(12) var<uniform> params: View;

#import lib/fullscreen

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return fullscreen(index);
}

struct Walked {
    sum: vec4<f32>,
    found: bool,
}

// Node i as seen along the ray: (x, y) off the ray, z, scalar.
fn seen(i: u32, sight: Sight) -> vec4<f32> {
    let q = textureLoad(projected, at(i), 0);
    return vec4(off_ray(q.xyz, sight), q.zw);
}

// What bounds a walk besides the mesh.
struct Span {
    // What a step in z is worth in the unit of the mode.
    scale: f32,
    // z at which the ray ends.
    end: f32,
    // The unit direction of the ray in the local frame.
    way: vec3<f32>,
}

fn gradient_at(i: u32) -> vec3<f32> {
    return textureLoad(gradients, at(i), 0).xyz;
}

// Walks from boundary face `code` = 4 tet + face, until the mesh or the ray ends.
fn walk(code: u32, sight: Sight, span: Span, before: vec4<f32>) -> Walked {
    var sum = before;
    var t = code >> 2u;
    let nodes = textureLoad(tets, at(t), 0);
    // Counter-clockwise as seen from the eye.
    var f = face_corners(code & 3u);
    if BACKWARDS {
        f = f.xzy;
    }
    var ia = nodes[f.x];
    var ib = nodes[f.y];
    var ic = nodes[f.z];
    var a = seen(ia, sight);
    var b = seen(ib, sight);
    var c = seen(ic, sight);
    var w = vec3(cross2(b.xy, c.xy), cross2(c.xy, a.xy), cross2(a.xy, b.xy));
    var all = nodes.x ^ nodes.y ^ nodes.z ^ nodes.w;
    let start_share = 1.0 / max(abs(w.x + w.y + w.z), 1e-30);
    var z = clamp(dot(w, vec3(a.z, b.z, c.z)) * start_share, min(a.z, min(b.z, c.z)), max(a.z, max(b.z, c.z)));
    var s = clamp(dot(w, vec3(a.w, b.w, c.w)) * start_share, min(a.w, min(b.w, c.w)), max(a.w, max(b.w, c.w)));
    var ga = vec3(0.0);
    var gb = vec3(0.0);
    var gc = vec3(0.0);
    var g = vec3(0.0);
    if LIT {
        ga = gradient_at(ia);
        gb = gradient_at(ib);
        gc = gradient_at(ic);
        g = (w.x * ga + w.y * gb + w.z * gc) * start_share;
    }
    var last = t;
    var mark = NONE;
    var steps = 0u;
    loop {
        if t == NONE || t == mark || steps >= params.cap || is_opaque(sum) {
            break;
        }
        // A ray that meets a tet again goes in a circle: marks at powers of two find every one.
        if (steps & (steps - 1u)) == 0u {
            mark = t;
        }
        steps += 1u;
        last = t;
        let id = all ^ ia ^ ib ^ ic;
        let d = seen(id, sight);
        let da = cross2(a.xy, d.xy);
        let db = cross2(b.xy, d.xy);
        let dc = cross2(c.xy, d.xy);
        // Which of a, b and c is left behind: the ray leaves through the other two and d.
        let drop_c = da <= 0.0 && db >= 0.0;
        let drop_b = da > 0.0 && dc <= 0.0;
        let drop_a = !(drop_b || drop_c);
        let dropped = select(select(ia, ib, drop_b), ic, drop_c);
        let rank = select(0u, 1u, ia < dropped) + select(0u, 1u, ib < dropped)
            + select(0u, 1u, ic < dropped) + select(0u, 1u, id < dropped);
        let link = textureLoad(links, at(t * 4u + rank), 0);
        a = select(a, d, drop_a);
        b = select(b, d, drop_b);
        c = select(c, d, drop_c);
        ia = select(ia, id, drop_a);
        ib = select(ib, id, drop_b);
        ic = select(ic, id, drop_c);
        w = vec3(
            select(select(w.x, -dc, drop_b), db, drop_c),
            select(select(w.y, dc, drop_a), -da, drop_c),
            select(select(w.z, -db, drop_a), da, drop_b),
        );
        let share = 1.0 / max(abs(w.x + w.y + w.z), 1e-30);
        var next_g = vec3(0.0);
        if LIT {
            let gd = gradient_at(id);
            ga = select(ga, gd, drop_a);
            gb = select(gb, gd, drop_b);
            gc = select(gc, gd, drop_c);
            next_g = (w.x * ga + w.y * gb + w.z * gc) * share;
        }
        var next_s = clamp(dot(w, vec3(a.w, b.w, c.w)) * share, min(a.w, min(b.w, c.w)), max(a.w, max(b.w, c.w)));
        if CELLS {
            s = params.scalar.x * textureLoad(cells, at(t), 0).x + params.scalar.y;
            next_s = s;
        }
        var next_z = dot(w, vec3(a.z, b.z, c.z)) * share;
        if BACKWARDS {
            next_z = clamp(next_z, min(z, min(a.z, min(b.z, c.z))), z);
            if next_z < params.near {
                let share_seen = clamp((z - params.near) / (z - next_z), 0.0, 1.0);
                next_s = mix(s, next_s, share_seen);
                next_g = mix(g, next_g, share_seen);
                next_z = min(z, params.near);
                let part = Segment(vec2(next_s, s), (z - next_z) * span.scale, shaded(g, next_g, span.way));
                return Walked(begun(gather_in_front(sum, part)), true);
            }
            sum = gather_in_front(sum, Segment(vec2(next_s, s), (z - next_z) * span.scale, shaded(g, next_g, span.way)));
        } else {
            next_z = clamp(next_z, z, max(z, max(a.z, max(b.z, c.z))));
            if OCCLUDED && next_z > span.end {
                let share_seen = clamp((span.end - z) / (next_z - z), 0.0, 1.0);
                next_s = mix(s, next_s, share_seen);
                next_g = mix(g, next_g, share_seen);
                next_z = max(z, span.end);
                let part = Segment(vec2(s, next_s), (next_z - z) * span.scale, shaded(g, next_g, span.way));
                return Walked(gather(sum, part), true);
            }
            sum = gather(sum, Segment(vec2(s, next_s), (next_z - z) * span.scale, shaded(g, next_g, span.way)));
        }
        s = next_s;
        z = next_z;
        g = next_g;
        t = link.x;
        all = link.y;
    }
    if is_opaque(sum) {
        return Walked(sum, true);
    }
    // It must have come out through a face of the tet it was in last.
    let home = textureLoad(tets, at(last), 0);
    let at_face = any(home == vec4(ia)) && any(home == vec4(ib)) && any(home == vec4(ic));
    return Walked(sum, t == NONE && at_face);
}

// Walks again along slightly other rays when a ray runs in circles, as one may that lies exactly
// in an edge; counts it as lost when they do as well.
fn walk_safely(code: u32, sight: Sight, span: Span, before: vec4<f32>) -> vec4<f32> {
    var along = sight;
    var walked = Walked(before, false);
    for (var attempt = 0u; attempt < 4u && !walked.found; attempt++) {
        walked = walk(code, along, span, before);
        along.origin += vec2(1.7e-6, -1.1e-6);
    }
    if !walked.found {
        atomicAdd(&lost[0], 1u);
    }
    return walked.sum;
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<u32>(position.xy);
    let start = textureLoad(starts, pixel, 0).xy;
    var sum = vec4(0.0);
    var starting = start.y != NONE;
    if BACKWARDS {
        // The eye is inside where the nearest face of all shows its back.
        let front = textureLoad(fronts, pixel, 0).xy;
        starting = starting && (front.y == NONE || bitcast<f32>(start.x) >= bitcast<f32>(front.x));
    } else {
        sum = textureLoad(gathered, pixel, 0);
        starting = starting && !is_opaque(sum);
    }
    let sight = sight_at(params, position.xy);
    var span: Span;
    let length = sqrt(1.0 + dot(sight.slope, sight.slope));
    span.scale = length * select(params.unit, params.opacity, MODE == COMPOSITE);
    span.end = 3e38;
    span.way = way_of(sight.slope);
    if OCCLUDED {
        span.end = z_of_depth(params, textureLoad(occluder, pixel, 0));
        starting = starting && (BACKWARDS || z_of_depth(params, bitcast<f32>(start.x)) < span.end);
    }
    if starting {
        if !BACKWARDS {
            sum = begun(sum);
        }
        sum = walk_safely(start.y, sight, span, sum);
    }
    return sum;
}
