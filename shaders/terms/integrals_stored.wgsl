// Reads the table of integrals from a storage texture.
#term table
#import lib/integrals

@group(0) @binding(next) var table: texture_storage_2d<rgba32uint, read>;

fn table_at(point: i32, row: u32) -> vec4<u32> {
    return textureLoad(table, vec2(point, i32(row)));
}
