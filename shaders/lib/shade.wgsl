// Two-sided Blinn-Phong shading of ray segments, weighted by the gradient magnitude. CPU reference:
// `render::light::shade`. Needs lib/view.

// Whether lighting is enabled.
override LIGHTING: bool = false;
// Whether shadows are enabled.
override SHADOWS: bool = false;
// Whether gradients and shadow values are read per node.
override PER_NODE_LIGHT: bool = false;

// The constants of `render::light`.
const AMBIENT: f32 = 0.4;
const DIFFUSE: f32 = 0.7;
const SPECULAR: f32 = 0.22;
const GRADIENT_HALF_SATURATION: f32 = 2.0;

// Unit vectors in the local frame: towards the light, and halfway between light and eye.
struct LightVectors {
    towards: vec3<f32>,
    half_way: vec3<f32>,
}

// Returns the light vectors of a ray with unit direction `way` away from the eye.
fn light_vectors(view: View, way: vec3<f32>) -> LightVectors {
    let towards = select(view.light.xyz, -way, view.light.w > 0.5);
    let half_way = towards - way;
    return LightVectors(towards, half_way / max(length(half_way), 1e-6));
}

// Returns the factor on colours, and the specular term added in proportion to opacity; vectors are
// in the local frame.
fn shade(gradient: vec3<f32>, lights: LightVectors) -> vec2<f32> {
    let steep = length(gradient);
    return shade_by(gradient, lights, steep / (steep + GRADIENT_HALF_SATURATION));
}

// As `shade`, for a surface normal to the gradient, independent of its magnitude.
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

// Returns x^32, without the logarithm of pow.
fn specular_power(x: f32) -> f32 {
    let x2 = x * x;
    let x4 = x2 * x2;
    let x8 = x4 * x4;
    let x16 = x8 * x8;
    return x16 * x16;
}
