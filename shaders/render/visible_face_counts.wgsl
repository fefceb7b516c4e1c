// Writes the vertex counts of the layer draws from the number of covered faces.

#import lib/array

struct CoverCounts {
    records: u32,
}

// Draw arguments of the covered faces; the first word is their vertex count.
@group(0) @binding(0) var<storage, read> covered: array<u32, 4>;
// Draw arguments of even and of odd layers, 8 words per layer; those of the search for the next
// layer come first.
@group(0) @binding(1) var<storage, read_write> even: array<u32>;
@group(0) @binding(2) var<storage, read_write> odd: array<u32>;
@group(0) @binding(3) var<uniform> params: CoverCounts;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.records {
        return;
    }
    if 8u * i < arrayLength(&even) {
        even[8u * i] = covered[0];
    }
    if 8u * i < arrayLength(&odd) {
        odd[8u * i] = covered[0];
    }
}
