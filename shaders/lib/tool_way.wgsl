// Tools on their way through a step.

#import lib/tool

@group(0) @binding(next) var<storage, read_write> tools: array<Tool>;

// Has tools that touched come to a stage of their way, from where they are.
fn go_to_stage(stage: u32, stages: u32) {
    let share = f32(stage) / f32(stages);
    for (var k = 0u; k < arrayLength(&tools); k++) {
        let from_turn = tools[k].from_turn;
        let to_turn = tools[k].to_turn;
        if stage == stages {
            tools[k].at_place = tools[k].to_place;
            tools[k].at_turn = to_turn;
        } else {
            tools[k].at_place = mix(tools[k].from_place, tools[k].to_place, share);
            // A turn and its negative are the same.
            let near = select(-to_turn, to_turn, dot(from_turn, to_turn) >= 0.0);
            tools[k].at_turn = normalize(mix(from_turn, near, share));
        }
    }
}
