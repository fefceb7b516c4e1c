// Scattering of light paths: a phase function in soft tissue, and a rough dielectric over a diffuse
// base where the gradient is steep. Needs lib/path_random, and `params: Path` of the importing
// shader. CPU reference: `render::path::lobes`.
//
// The phase function is that of Henyey and Greenstein (1941). The surface has a specular lobe of
// microfacets (GGX: Walter et al. 2007; visible normals: Heitz 2018) and a diffuse lobe that takes
// what the specular one leaves (Kelemen and Szirmay-Kalos 2001), so that a white surface reflects
// all light at every roughness.

const PI: f32 = 3.14159265358979;
// Fresnel reflectance at normal incidence: a refractive index of 1.4, as of tissue.
const F0: f32 = 0.0278;
// Entries of the table of directional albedos, less one.
const ALBEDO_STEPS: f32 = 31.0;

// Returns two unit vectors perpendicular to the unit vector n and each other (Duff et al. 2017).
fn basis(n: vec3<f32>) -> mat3x3<f32> {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return mat3x3(
        vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x),
        vec3(b, s + n.y * n.y * a, -n.y),
        n,
    );
}

// Returns the phase function at the cosine between the directions before and after.
fn phase(cosine: f32) -> f32 {
    let g = params.anisotropy;
    let base = max(1.0 + g * g - 2.0 * g * cosine, 1e-6);
    return (1.0 - g * g) / (4.0 * PI * base * sqrt(base));
}

// Returns a direction after scattering, distributed as the phase function.
fn sample_phase(d: vec3<f32>) -> vec3<f32> {
    let g = params.anisotropy;
    let u = random();
    var cosine = 1.0 - 2.0 * u;
    if abs(g) > 1e-3 {
        let share = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
        cosine = (1.0 + g * g - share * share) / (2.0 * g);
    }
    cosine = clamp(cosine, -1.0, 1.0);
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    let turn = 2.0 * PI * random();
    return basis(d) * vec3(sine * cos(turn), sine * sin(turn), cosine);
}

// Returns the directional albedo of the specular lobe at the cosine of incidence.
fn specular_albedo(cosine: f32) -> f32 {
    let x = clamp(cosine, 0.0, 1.0) * ALBEDO_STEPS;
    let k = min(u32(x), u32(ALBEDO_STEPS) - 1u);
    let low = params.albedos[k / 4u][k % 4u];
    let high = params.albedos[(k + 1u) / 4u][(k + 1u) % 4u];
    return mix(low, high, x - f32(k));
}

fn fresnel(cosine: f32) -> f32 {
    let x = 1.0 - clamp(cosine, 0.0, 1.0);
    return F0 + (1.0 - F0) * x * x * x * x * x;
}

// Returns the masking function of one direction times 2 cos: cos + √(α² + (1 − α²) cos²).
fn masking(cosine: f32) -> f32 {
    let a2 = params.alpha * params.alpha;
    return cosine + sqrt(a2 + (1.0 - a2) * cosine * cosine);
}

struct LobeValue {
    // Colour reflected, times the cosine.
    value: vec3<f32>,
    // Density per solid angle of sample_surface.
    density: f32,
}

// Returns the share of samples of the specular lobe.
fn specular_share(cosine: f32, colour: vec3<f32>) -> f32 {
    let specular = specular_albedo(cosine);
    let diffuse = (1.0 - specular) * max(colour.x, max(colour.y, colour.z));
    return specular / max(specular + diffuse, 1e-6);
}

// Returns the reflection of a surface with unit normal n from w (towards where the path came from) to l.
fn surface_value(n: vec3<f32>, w: vec3<f32>, l: vec3<f32>, colour: vec3<f32>) -> LobeValue {
    let cw = dot(n, w);
    let cl = dot(n, l);
    if cw <= 0.0 || cl <= 0.0 {
        return LobeValue(vec3(0.0), 0.0);
    }
    let h = normalize(w + l);
    let ch = clamp(dot(n, h), 0.0, 1.0);
    let a2 = params.alpha * params.alpha;
    let bottom = 1.0 + (a2 - 1.0) * ch * ch;
    let d = a2 / (PI * bottom * bottom);
    // D G / (4 cw cl) with the height-correlated masking replaced by the product of both sides.
    let gw = masking(cw);
    let gl = masking(cl);
    let specular = d * fresnel(dot(w, h)) / (gw * gl);
    let diffuse = colour * (1.0 - specular_albedo(cw)) * (1.0 - specular_albedo(cl)) / (PI * (1.0 - params.mean_albedo));
    let share = specular_share(cw, colour);
    let density = share * d / (2.0 * gw) + (1.0 - share) * cl / PI;
    return LobeValue((diffuse + specular) * cl, density);
}

// Returns a direction in which the surface reflects w.
fn sample_surface(n: vec3<f32>, w: vec3<f32>, colour: vec3<f32>) -> vec3<f32> {
    let frame = basis(n);
    let u = random();
    let v = 2.0 * PI * random();
    if random() >= specular_share(dot(n, w), colour) {
        let r = sqrt(u);
        return frame * vec3(r * cos(v), r * sin(v), sqrt(max(1.0 - u, 0.0)));
    }
    // Normals that are visible from w, in the space where the microfacets are a hemisphere.
    let local = w * frame;
    let a = params.alpha;
    let stretched = normalize(vec3(a * local.xy, local.z));
    let side = basis(stretched);
    let r = sqrt(u);
    let x = r * cos(v);
    let s = 0.5 * (1.0 + stretched.z);
    // The projected disc has its lower half squeezed; its axes are those of Heitz (2018).
    var first = side[0];
    let flat_length = dot(stretched.xy, stretched.xy);
    if flat_length > 1e-12 {
        first = vec3(-stretched.y, stretched.x, 0.0) * inverseSqrt(flat_length);
    }
    let second = cross(stretched, first);
    let y = mix(sqrt(max(1.0 - x * x, 0.0)), r * sin(v), s);
    let normal = x * first + y * second + sqrt(max(1.0 - x * x - y * y, 0.0)) * stretched;
    let h = normalize(vec3(a * normal.xy, max(normal.z, 1e-7)));
    return frame * (2.0 * dot(local, h) * h - local);
}
