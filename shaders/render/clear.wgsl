// An empty layer: no face, farthest depth. A draw, so that it can be left out on the GPU.

#import lib/fullscreen
#import lib/tet

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return fullscreen(index);
}

@fragment
fn fragment() -> @location(0) vec2<u32> {
    return vec2(0u, NONE);
}
