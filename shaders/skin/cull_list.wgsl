// Compacts the corner indices of the visible triangles into a contiguous index list.

#import lib/array

struct CullList {
    runs: u32,
}

@group(0) @binding(0) var<storage, read> marks: array<u32>;
@group(0) @binding(1) var<storage, read> corners: array<u32>;
@group(0) @binding(2) var<storage, read_write> drawn: array<u32>;
@group(0) @binding(3) var<uniform> params: CullList;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let run = invocation_index(id, groups);
    if run >= params.runs {
        return;
    }
    var mask = marks[2u * run];
    var place = 3u * marks[2u * run + 1u];
    while mask != 0u {
        let corner = 3u * (32u * run + countTrailingZeros(mask));
        for (var k = 0u; k < 3u; k++) {
            drawn[place + k] = corners[corner + k];
        }
        place += 3u;
        mask &= mask - 1u;
    }
}
