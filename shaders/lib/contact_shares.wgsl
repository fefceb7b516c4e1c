// What tools exert on points of the boundary, and what that adds to the matrix.

#import lib/contact

@group(0) @binding(next) var velocities: texture_2d<f32>;
// How these changed last.
@group(0) @binding(next) var ways: texture_2d<f32>;
// Those by which friction takes normal forces.
@group(0) @binding(next) var rubbed: texture_2d<f32>;
@group(0) @binding(next) var<storage, read> pushing: Pushing;

struct ContactParams {
    items: u32,
    dt: f32,
    // The speed below which friction holds.
    least_speed: f32,
    _pad0: u32,
}
@group(0) @binding(next) var<uniform> params: ContactParams;

struct Share {
    force: vec3<f32>,
    // xx, yy, zz, and xy, xz, yz; of A = −h² ∂f/∂x − h ∂f/∂v.
    diagonal: vec3<f32>,
    mixed: vec3<f32>,
    touches: bool,
    // 1 where the point is inside by more than it may be in the end.
    pierced: f32,
}

// Three nodes: where they start from, their velocities, how these changed last, and those by which
// friction goes.
struct Corners {
    x: mat3x3<f32>,
    v: mat3x3<f32>,
    way: mat3x3<f32>,
    rubbed: mat3x3<f32>,
}

// What slides resists as if this part of it stuck, or it would slide back and forth.
const SLIDES: f32 = 0.1;

// The gap from which on a tool pushes as iterations are.
fn gap_of(k: u32) -> f32 {
    return max(tools[k].numbers.y, pushing.wide);
}

// The share of tool k in a point of nodes with the weights w, which stands for A K.
fn share_of(k: u32, at: Corners, w: vec3<f32>, ak: f32) -> Share {
    let h = params.dt;
    let friction = tools[k].numbers.x;
    let gap = gap_of(k);
    let speed = at.v * w;
    let now = touch(k, from_tool(at.x, tools[k].at_place.xyz, w, h * speed), tools[k].at_turn);
    var barrier = barrier_at(now.w / gap);
    var share = Share(vec3(0.0), vec3(0.0), vec3(0.0), false, 0.0);
    share.pierced = select(0.0, 1.0, now.w < -tools[k].limits.x);
    if pushing.follows != 0u {
        let way = pushing.tried * h * (at.way * w);
        let p = from_tool(at.x, tools[k].last_place.xyz, w, h * speed - way);
        let was = touch(k, p, tools[k].last_turn);
        let known = barrier_at(was.w / gap);
        if known.y < 0.0 {
            // What touched goes along, as if the barrier were a spring both ways: tools that draw
            // back by more than the gap would let go of all at once.
            barrier = vec3(0.0, known.y + known.z * (now.w - was.w) / gap, known.z);
        }
    }
    if friction > 0.0 {
        let p = from_tool(at.x, tools[k].lag_place.xyz, w, h * (at.rubbed * w));
        let was = touch(k, p, tools[k].lag_turn);
        let limit = -friction * ak * barrier_at(was.w / tools[k].numbers.y).y;
        if limit > 0.0 {
            let own = turned_by(undone(tools[k].lag_turn), p);
            let moved = tools[k].to_place.xyz - tools[k].from_place.xyz
                + turned_apart(tools[k].from_turn, tools[k].to_turn, own);
            let n = was.xyz;
            var slide = speed - moved / h;
            slide -= dot(n, slide) * n;
            let fast = length(slide);
            let least = params.least_speed;
            let y = fast / least;
            let slope = select((2.0 - y) / least, 1.0 / fast, y >= 1.0);
            share.touches = true;
            share.force = -limit * slope * slide;
            let c = h * limit * slope;
            share.diagonal = c * (1.0 - n * n);
            share.mixed = -c * n.xxy * n.yzz;
            let bend = max(2.0 * (1.0 - y) / least, SLIDES * slope);
            let along = slide / max(fast, 1e-30);
            let less = h * limit * (bend - slope);
            share.diagonal += less * along * along;
            share.mixed += less * along.xxy * along.yzz;
        }
    }
    if barrier.z > 0.0 {
        let n = now.xyz;
        let c = h * h * ak * barrier.z / gap;
        share.touches = true;
        share.force -= ak * barrier.y * n;
        share.diagonal += c * n * n;
        share.mixed += c * n.xxy * n.yzz;
    }
    return share;
}
