// Motion of tools through the stages of a step.

#import lib/tool

@group(0) @binding(next) var<storage, read_write> tools: array<Tool>;

// Moves all tools to a stage of their motion during the step.
fn set_tool_stage(stage: u32, stages: u32) {
    let fraction = f32(stage) / f32(stages);
    for (var k = 0u; k < arrayLength(&tools); k++) {
        let from_rotation = tools[k].start_rotation;
        let to_rotation = tools[k].target_rotation;
        if stage == stages {
            tools[k].current_position = tools[k].target_position;
            tools[k].current_rotation = to_rotation;
        } else {
            tools[k].current_position = mix(tools[k].start_position, tools[k].target_position, fraction);
            // A quaternion and its negative represent the same rotation.
            let nearest_target = select(-to_rotation, to_rotation, dot(from_rotation, to_rotation) >= 0.0);
            tools[k].current_rotation = normalize(mix(from_rotation, nearest_target, fraction));
        }
    }
}
