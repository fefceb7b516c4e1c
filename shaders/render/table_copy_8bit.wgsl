// Copies a computed layer of the table to an 8-bit texture.

@group(0) @binding(0) var whole: texture_2d<f32>;
@group(0) @binding(1) var layer: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let size = textureDimensions(whole);
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    textureStore(layer, id.xy, textureLoad(whole, id.xy, 0));
}
