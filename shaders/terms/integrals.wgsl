// Loads the table of integrals from a sampled texture.
#term table
#import lib/integrals

@group(0) @binding(next) var table: texture_2d<u32>;

fn table_at(point: i32, row: u32) -> vec4<u32> {
    return textureLoad(table, vec2(point, i32(row)), 0);
}
