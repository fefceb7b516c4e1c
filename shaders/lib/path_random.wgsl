// Random numbers of light paths: a permuted congruential generator (O'Neill 2014) whose state is a
// hash of the pixel, the sample and the seed, so that a picture depends on nothing else.

var<private> random_state: u32;

fn hashed(value: u32) -> u32 {
    let word = ((value >> ((value >> 28u) + 4u)) ^ value) * 277803737u;
    return (word >> 22u) ^ word;
}

fn seed_random(pixel: vec2<u32>, sample: u32, seed: u32) {
    random_state = hashed(pixel.x * 747796405u + 2891336453u);
    random_state = hashed((random_state ^ pixel.y) * 747796405u + 2891336453u);
    random_state = hashed((random_state ^ sample) * 747796405u + 2891336453u);
    random_state = hashed((random_state ^ seed) * 747796405u + 2891336453u);
}

// Returns a number from 0 to below 1.
fn random() -> f32 {
    random_state = random_state * 747796405u + 2891336453u;
    return f32(hashed(random_state) >> 8u) * (1.0 / 16777216.0);
}
