// Mesh traversal over projected vertices: the three vertices of the face just crossed are kept in
// camera space, projected along the ray. Each step fetches the fourth vertex of the next tet, whose
// id follows by exclusive or, and two sign tests select the exit face. After Aman et al., "Compact
// tetrahedralization-based acceleration structures for ray tracing" (2022).
//
// The ray is the origin of the projection plane: vertex (x, y, z) is projected to (x, y) - origin -
// slope z, and the weights of a point in face ABC are the areas (B × C, C × A, A × B) over their
// sum.

#each reads #import terms/TERM
// The four nodes of each tet.
@group(0) @binding(next) var tets: texture_2d<u32>;
// One scalar per tet, if CELL_SCALARS.
@group(0) @binding(next) var cells: texture_2d<f32>;

#each table #import terms/TERM
#each scan #import terms/TERM
#each intervals #import terms/TERM
#import lib/array
#import lib/view
#import lib/tet
#import lib/segment
#import lib/ray_projection
#import lib/walk_frame

// Returns node i projected along the ray: (x, y) offset from the ray, z, scalar.
fn project_vertex(i: u32, frame: RayFrame) -> vec4<f32> {
    let q = projected_at(i);
    return vec4(project_to_ray_plane(q.xyz, frame), q.zw);
}

// Returns the position of node i, in the local frame.
fn corner_at(i: u32) -> vec3<f32> {
    let q = projected_at(i).xyz - vec3(params.right.w, params.up.w, params.forward.w);
    return q.x * params.right.xyz + q.y * params.up.xyz + q.z * params.forward.xyz;
}

fn rest_position(i: u32) -> vec3<f32> {
    return textureLoad(rests, array_texel(i), 0).xyz;
}

// Returns the sum of the rest positions of a, b and c times w. They are read for each face: kept from
// one face to the next, they would take nine registers of a GPU.
fn weighted_rest_position(w: vec3<f32>, a: u32, b: u32, c: u32) -> vec3<f32> {
    return w.x * rest_position(a) + w.y * rest_position(b) + w.z * rest_position(c);
}

fn traverse(code: u32, ray: Ray, before: vec4<f32>) -> TraversalResult {
    let frame = ray.frame;
    var sum = before;
    var t = code >> 2u;
    let nodes = textureLoad(tets, array_texel(t), 0);
    // Counter-clockwise as seen from the eye.
    var f = face_corners(code & 3u);
    if BACKWARD_TRAVERSAL {
        f = f.xzy;
    }
    var ia = nodes[f.x];
    var ib = nodes[f.y];
    var ic = nodes[f.z];
    var a = project_vertex(ia, frame);
    var b = project_vertex(ib, frame);
    var c = project_vertex(ic, frame);
    var w = vec3(cross2(b.xy, c.xy), cross2(c.xy, a.xy), cross2(a.xy, b.xy));
    var node_xor = nodes.x ^ nodes.y ^ nodes.z ^ nodes.w;
    let start_share = 1.0 / max(abs(w.x + w.y + w.z), 1e-30);
    var here: RaySample;
    here.z = clamp(dot(w, vec3(a.z, b.z, c.z)) * start_share, min(a.z, min(b.z, c.z)), max(a.z, max(b.z, c.z)));
    here.s = clamp(dot(w, vec3(a.w, b.w, c.w)) * start_share, min(a.w, min(b.w, c.w)), max(a.w, max(b.w, c.w)));
    var ga = vec4(0.0);
    var gb = vec4(0.0);
    var gc = vec4(0.0);
    if USE_REST_POSITIONS {
        here.rest = weighted_rest_position(w, ia, ib, ic) * start_share;
    }
    if PER_NODE_LIGHT {
        ga = gradient_at(ia);
        gb = gradient_at(ib);
        gc = gradient_at(ic);
        here.gradient = (w.x * ga.xyz + w.y * gb.xyz + w.z * gc.xyz) * start_share;
        if SHADOWS {
            here.bright = (w.x * ga.w + w.y * gb.w + w.z * gc.w) * start_share;
        }
    }
    let first = here.z;
    var last = t;
    // Whether the ray reached an opaque object.
    var ended = false;
    let cap = params.max_steps;
    var cycle_mark = NONE;
    var steps = 0u;
    loop {
        if (t == NONE) | (t == cycle_mark) | (steps >= cap) | is_terminated(sum) | ended {
            break;
        }
        // Cycle detection: tets marked at powers of two reveal every cycle.
        cycle_mark = select(cycle_mark, t, (steps & (steps - 1u)) == 0u);
        steps += 1u;
        last = t;
        let opposite_node = node_xor ^ ia ^ ib ^ ic;
        let opposite = project_vertex(opposite_node, frame);
        let da = cross2(a.xy, opposite.xy);
        let db = cross2(b.xy, opposite.xy);
        let dc = cross2(c.xy, opposite.xy);
        // Selects the vertex of a, b and c to drop: the ray leaves through the other two and d.
        let drop_c = (da <= 0.0) & (db >= 0.0);
        let drop_b = (da > 0.0) & (dc <= 0.0);
        let drop_a = !(drop_b | drop_c);
        let dropped_node = select(select(ia, ib, drop_b), ic, drop_c);
        let rank = select(0u, 1u, ia < dropped_node) + select(0u, 1u, ib < dropped_node)
            + select(0u, 1u, ic < dropped_node) + select(0u, 1u, opposite_node < dropped_node);
        let link = link_at(t * 4u + rank);
        a = select(a, opposite, drop_a);
        b = select(b, opposite, drop_b);
        c = select(c, opposite, drop_c);
        ia = select(ia, opposite_node, drop_a);
        ib = select(ib, opposite_node, drop_b);
        ic = select(ic, opposite_node, drop_c);
        w = vec3(cross2(b.xy, c.xy), cross2(c.xy, a.xy), cross2(a.xy, b.xy));
        let share = 1.0 / max(abs(w.x + w.y + w.z), 1e-30);
        var next: RaySample;
        if PER_NODE_LIGHT {
            let gd = gradient_at(opposite_node);
            ga = select(ga, gd, drop_a);
            gb = select(gb, gd, drop_b);
            gc = select(gc, gd, drop_c);
            next.gradient = (w.x * ga.xyz + w.y * gb.xyz + w.z * gc.xyz) * share;
            if SHADOWS {
                next.bright = (w.x * ga.w + w.y * gb.w + w.z * gc.w) * share;
            }
        }
        if USE_REST_POSITIONS {
            next.rest = weighted_rest_position(w, ia, ib, ic) * share;
        }
        next.s = clamp(dot(w, vec3(a.w, b.w, c.w)) * share, min(a.w, min(b.w, c.w)), max(a.w, max(b.w, c.w)));
        if CELL_SCALARS {
            here.s = params.scalar.x * textureLoad(cells, array_texel(t), 0).x + params.scalar.y;
            next.s = here.s;
        }
        next.z = dot(w, vec3(a.z, b.z, c.z)) * share;
        if BACKWARD_TRAVERSAL {
            next.z = clamp(next.z, min(here.z, min(a.z, min(b.z, c.z))), here.z);
            if next.z < params.near {
                next = lerp_sample(here, next, clamp((here.z - params.near) / (here.z - next.z), 0.0, 1.0));
                next.z = min(here.z, params.near);
                return TraversalResult(initial_accumulator(accumulate_until_depth(sum, Segment(next, here, t), ray)), true, vec2(next.z, first));
            }
            sum = accumulate_until_depth(sum, Segment(next, here, t), ray);
        } else {
            next.z = clamp(next.z, here.z, max(here.z, max(a.z, max(b.z, c.z))));
            if HAS_DEPTH {
                ended = next.z > ray.end;
                if ended {
                    next = lerp_sample(here, next, clamp((ray.end - here.z) / (next.z - here.z), 0.0, 1.0));
                    next.z = max(here.z, ray.end);
                }
            }
            sum = accumulate_segment(sum, Segment(here, next, t), ray);
        }
        here = next;
        t = link.x;
        node_xor = link.y;
    }
    let depth_range = select(vec2(first, here.z), vec2(here.z, first), BACKWARD_TRAVERSAL);
    if is_terminated(sum) | ended {
        return TraversalResult(sum, true, depth_range);
    }
    // The ray must leave the mesh through a face of its last tet.
    let home = textureLoad(tets, array_texel(last), 0);
    let at_face = any(home == vec4(ia)) && any(home == vec4(ib)) && any(home == vec4(ic));
    return TraversalResult(sum, t == NONE && at_face, depth_range);
}
