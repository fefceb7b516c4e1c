// Copies depths from one target to another.

@group(0) @binding(0) var depths: texture_depth_2d;

#import lib/fullscreen

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return fullscreen(index);
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @builtin(frag_depth) f32 {
    return textureLoad(depths, vec2<u32>(position.xy), 0);
}
