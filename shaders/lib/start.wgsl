// Where an implicit step of finite elements may start from, as velocities over the step: to stay,
// to go on, and to go on changing as in the step before. Of these the one of least incremental
// potential is taken, E + Σ ½ m |w − v|² − h w·f, f the weight and the external force.

const GUESS_COUNT: u32 = 3u;

fn guess_velocity(choice: u32, v: vec3<f32>, before: vec3<f32>, free: bool) -> vec3<f32> {
    if !free || choice == 0u {
        return vec3(0.0);
    }
    return select(2.0 * v - before, v, choice == 1u);
}
