// Prefix sum over a bitmask of triangles to draw: the number of set bits before every 32 triangles
// and in total, computed by one workgroup. Compaction with these offsets preserves triangle order.

#import lib/array

struct BitmaskPrefixSum {
    runs: u32,
}

// For every 32 triangles: the bitmask of drawn triangles, and the number drawn before them.
@group(0) @binding(0) var<storage, read_write> marks: array<u32>;
// Indirect draw arguments; this pass writes the first word, the number of vertices.
@group(0) @binding(1) var<storage, read_write> arguments: array<u32>;
@group(0) @binding(2) var<uniform> params: BitmaskPrefixSum;

var<workgroup> sums: array<u32, 256>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    let share = (params.runs + 255u) / 256u;
    let first = min(lane * share, params.runs);
    let last = min(first + share, params.runs);
    var sum = 0u;
    for (var run = first; run < last; run++) {
        sum += countOneBits(marks[2u * run]);
    }
    sums[lane] = sum;
    workgroupBarrier();
    for (var step = 1u; step < 256u; step = step << 1u) {
        let before = select(0u, sums[max(lane, step) - step], lane >= step);
        workgroupBarrier();
        sums[lane] += before;
        workgroupBarrier();
    }
    var next = sums[lane] - sum;
    for (var run = first; run < last; run++) {
        marks[2u * run + 1u] = next;
        next += countOneBits(marks[2u * run]);
    }
    if lane == 255u {
        arguments[0] = 3u * sums[255];
    }
}
