// Light on what a ray passes: Blinn and Phong's, on both sides of a gradient, the more the steeper
// it is. The twin of `render::light::shade`. Needs lib/view.

// Whether there is light.
override LIGHTING: bool = false;
// Whether what is before the light dims it.
override SHADOWS: bool = false;
// Whether light reads what the nodes keep: gradients, and how much light comes there.
override PER_NODE_LIGHT: bool = false;

// The constants of `render::light`.
const AMBIENT: f32 = 0.4;
const DIFFUSE: f32 = 0.7;
const SPECULAR: f32 = 0.22;
const GRADIENT_HALF_SATURATION: f32 = 2.0;

// Unit directions from what a ray passes, in the local frame: towards the light, and halfway between
// that and the eye.
struct LightVectors {
    towards: vec3<f32>,
    half_way: vec3<f32>,
}

// Those of a ray in the unit direction `way` away from the eye.
fn light_vectors(view: View, way: vec3<f32>) -> LightVectors {
    let towards = select(view.light.xyz, -way, view.light.w > 0.5);
    let half_way = towards - way;
    return LightVectors(towards, half_way / max(length(half_way), 1e-6));
}

// The factor on colours, and what is added to them in proportion to opacity; all is in the local frame.
fn shade(gradient: vec3<f32>, lights: LightVectors) -> vec2<f32> {
    let steep = length(gradient);
    return shade_by(gradient, lights, steep / (steep + GRADIENT_HALF_SATURATION));
}

// The same of a surface that the gradient stands on, however steep.
fn shade_surface(gradient: vec3<f32>, lights: LightVectors) -> vec2<f32> {
    return shade_by(gradient, lights, 1.0);
}

fn shade_by(gradient: vec3<f32>, lights: LightVectors, weight: f32) -> vec2<f32> {
    let steep = length(gradient);
    if steep < 1e-6 {
        return vec2(1.0, 0.0);
    }
    let n = gradient / steep;
    let diffuse = AMBIENT + DIFFUSE * abs(dot(n, lights.towards));
    return vec2(mix(1.0, diffuse, weight), SPECULAR * weight * specular_power(abs(dot(n, lights.half_way))));
}

// x^32, without the logarithm of pow.
fn specular_power(x: f32) -> f32 {
    let x2 = x * x;
    let x4 = x2 * x2;
    let x8 = x4 * x4;
    let x16 = x8 * x8;
    return x16 * x16;
}
