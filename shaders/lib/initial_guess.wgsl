// Initial guesses of an implicit finite element step, as velocities over the step: rest, constant
// velocity, constant acceleration. The guess of least incremental potential is selected: E + Σ ½ m
// |w − v|² − h w·f, f the weight and the external force.

const GUESS_COUNT: u32 = 3u;

fn guess_velocity(choice: u32, v: vec3<f32>, before: vec3<f32>, free: bool) -> vec3<f32> {
    if !free || choice == 0u {
        return vec3(0.0);
    }
    return select(2.0 * v - before, v, choice == 1u);
}
