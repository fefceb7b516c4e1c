// The largest extinction of a tet's range of scalars, relative to the largest of all; 0 for hidden
// tets.

#import lib/array

override CELL_SCALARS: bool = false;
override HAS_REGIONS: bool = false;

// As in lib/segment and lib/sections.
const HIDDEN: u32 = 0xffffu;
const ROW_MASK: u32 = 0x7fffu;
const COLOUR_LUT_SIZE: u32 = 1024u;

struct Majorants {
    tets: u32,
}

@group(0) @binding(0) var scalars: texture_2d<f32>;
@group(0) @binding(1) var tets: texture_2d<u32>;
@group(0) @binding(2) var cells: texture_2d<f32>;
@group(0) @binding(3) var rows: texture_2d<u32>;
@group(0) @binding(4) var colours: texture_2d<f32>;
@group(0) @binding(5) var majorants: texture_storage_2d<r32float, write>;
@group(0) @binding(6) var<uniform> params: Majorants;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let t = invocation_index(id, groups);
    if t >= params.tets {
        return;
    }
    var row = 0u;
    if HAS_REGIONS {
        row = textureLoad(rows, array_texel(t), 0).x;
    }
    var low: f32;
    var high: f32;
    if CELL_SCALARS {
        low = textureLoad(cells, array_texel(t), 0).x;
        high = low;
    } else {
        let ids = textureLoad(tets, array_texel(t), 0);
        low = 1.0;
        high = 0.0;
        for (var k = 0u; k < 4u; k++) {
            let s = textureLoad(scalars, array_texel(ids[k]), 0).x;
            low = min(low, s);
            high = max(high, s);
        }
        // The records hold the range in 16 bits.
        low -= 1.0 / 65535.0;
        high += 1.0 / 65535.0;
    }
    let last = f32(COLOUR_LUT_SIZE - 1u);
    let first_entry = u32(clamp(floor(low * last), 0.0, last));
    let last_entry = u32(clamp(ceil(high * last), 0.0, last));
    var most = 0.0;
    if row != HIDDEN {
        for (var k = first_entry; k <= last_entry; k++) {
            most = max(most, textureLoad(colours, array_texel((row & ROW_MASK) * COLOUR_LUT_SIZE + k), 0).w);
        }
    }
    // Rounding must not exceed the majorant.
    textureStore(majorants, array_texel(t), vec4(most * 1.00001, 0.0, 0.0, 0.0));
}
