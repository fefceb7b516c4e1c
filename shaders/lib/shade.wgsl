// Light on what a ray passes: Blinn and Phong's, on both sides of a gradient, the more the steeper
// it is. The twin of `render::light::shade`. Needs lib/view, and `params: View` of the shader
// that imports it.

// Whether there is light.
override LIT: bool = false;
// Whether what is before the light dims it.
override SHADOWED: bool = false;
// Whether light reads what the nodes keep: gradients, and how much light comes there.
override NODE_LIGHT: bool = false;

// The constants of `render::light`.
const AMBIENT: f32 = 0.4;
const DIFFUSE: f32 = 0.7;
const SHINE: f32 = 0.22;
const GLOSS: f32 = 32.0;
const FAINT: f32 = 2.0;

// The factor on colours, and what is added to them in proportion to opacity; `ray` is the unit
// direction away from the eye, and all is in the local frame.
fn shade(view: View, gradient: vec3<f32>, ray: vec3<f32>) -> vec2<f32> {
    let steep = length(gradient);
    return shade_by(view, gradient, ray, steep / (steep + FAINT));
}

// The same of a surface that the gradient stands on, however steep.
fn shade_surface(view: View, gradient: vec3<f32>, ray: vec3<f32>) -> vec2<f32> {
    return shade_by(view, gradient, ray, 1.0);
}

fn shade_by(view: View, gradient: vec3<f32>, ray: vec3<f32>, weight: f32) -> vec2<f32> {
    let steep = length(gradient);
    if steep < 1e-6 {
        return vec2(1.0, 0.0);
    }
    let n = gradient / steep;
    let light = select(view.light.xyz, -ray, view.light.w > 0.5);
    let half_way = light - ray;
    let l = length(half_way);
    let facing = select(0.0, abs(dot(n, half_way)) / max(l, 1e-6), l > 1e-6);
    return vec2(mix(1.0, AMBIENT + DIFFUSE * abs(dot(n, light)), weight), SHINE * weight * pow(facing, GLOSS));
}
