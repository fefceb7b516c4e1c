// What tools exert on points of the boundary, and what that adds to the matrix.

#import lib/contact

@group(0) @binding(next) var velocities: texture_2d<f32>;
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

// The share of tool k in a point of three nodes with the weights w, which stands for A K.
fn share_of(k: u32, x: mat3x3<f32>, v: mat3x3<f32>, before: mat3x3<f32>, w: vec3<f32>, ak: f32) -> Share {
    let h = params.dt;
    let friction = tools[k].numbers.x;
    let gap = tools[k].numbers.y;
    let speed = v * w;
    let now = touch(k, from_tool(x, tools[k].at_place.xyz, w, h * speed), tools[k].at_turn);
    var barrier = barrier_at(now.w / gap);
    var share = Share(vec3(0.0), vec3(0.0), vec3(0.0), false, 0.0);
    share.pierced = select(0.0, 1.0, now.w < -tools[k].limits.x);
    var limit = 0.0;
    if pushing.follows != 0u || friction > 0.0 {
        let p = from_tool(x, tools[k].lag_place.xyz, w, h * (before * w));
        let was = touch(k, p, tools[k].lag_turn);
        let known = barrier_at(was.w / gap);
        if pushing.follows != 0u && known.y < 0.0 {
            // What touched goes along with the tool, as if the barrier were a spring both ways: one
            // that draws back by more than its gap would let go of all at once.
            barrier = vec3(0.0, known.y + known.z * (now.w - was.w) / gap, known.z);
        }
        limit = -friction * ak * known.y;
        if limit > 0.0 {
            let own = turned_by(undone(tools[k].lag_turn), p);
            let moved = tools[k].to_place.xyz - tools[k].from_place.xyz
                + turned_by(tools[k].to_turn, own) - turned_by(tools[k].from_turn, own);
            let n = was.xyz;
            var slide = speed - moved / h;
            slide -= dot(n, slide) * n;
            let fast = length(slide);
            let least = params.least_speed;
            let y = fast / least;
            let slope = select((2.0 - y) / least, 1.0 / fast, y >= 1.0);
            share.touches = true;
            share.force = -limit * slope * slide;
            // What slides is held back as if it stuck, or it would slide back and forth.
            let c = h * limit * slope;
            share.diagonal = c * (1.0 - n * n);
            share.mixed = -c * n.xxy * n.yzz;
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
