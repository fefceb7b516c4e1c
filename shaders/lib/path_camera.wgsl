// Rays of light paths from the camera. Needs lib/path_random, lib/path_lobes, `Ray` and `params: Path`.

// Returns the ray of a pixel's sample, from the lens.
fn camera_ray(position: vec2<f32>) -> Ray {
    let slope = params.slope.xy * position + params.slope.zw;
    let base = params.base.xy * position + params.base.zw;
    // At z, the ray is at base + slope z across the view.
    let from_ = base + slope * params.near - vec2(params.right.w, params.up.w);
    var origin = from_.x * params.right.xyz + from_.y * params.up.xyz + (params.near - params.forward.w) * params.forward.xyz;
    var direction = slope.x * params.right.xyz + slope.y * params.up.xyz + params.forward.xyz;
    if params.lens > 0.0 {
        let target_point = origin + (params.focus - params.near) * direction;
        let r = params.lens * sqrt(random());
        let turn = 2.0 * PI * random();
        origin += r * cos(turn) * params.right.xyz + r * sin(turn) * params.up.xyz;
        direction = target_point - origin;
    }
    return Ray(origin, normalize(direction), 0.0, NONE, 0u);
}
