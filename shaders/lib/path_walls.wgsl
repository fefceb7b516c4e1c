// Surfaces of skins and tools that paths meet. The tree of their boxes is as that of lib/path_boxes;
// host side: `render::path::walls`.

override HAS_WALLS: bool = false;

// `wall_item` gives two items per node of the tree; then nine per triangle: three corners (w is the opacity), their
// normals, their colours (linear).
struct WallHit {
    distance: f32,
    // First item of the triangle.
    item: u32,
    u: f32,
    v: f32,
}

// Distance, in local units, by which a path leaves a surface.
const WALL_OFFSET: f32 = 2e-5;

// Returns the nearest triangle beyond the distance `after`.
fn nearest_wall(o: vec3<f32>, d: vec3<f32>, after: f32) -> WallHit {
    var best = WallHit(3e38, 0u, 0.0, 0.0);
    if !HAS_WALLS {
        return best;
    }
    let over = reciprocal(d);
    let leaves = params.wall_leaves;
    var i = 1u;
    loop {
        let range = box_range(wall_item(2u * i).xyz, wall_item(2u * i + 1u).xyz, o, over);
        let met = range.x <= range.y && range.y >= after && range.x <= best.distance;
        if met && i < leaves {
            i = 2u * i;
            continue;
        }
        if met {
            let first = (i - leaves) * LEAF_FACES;
            for (var k = first; k < min(first + LEAF_FACES, params.wall_count); k++) {
                let item = 4u * leaves + 9u * k;
                let p = wall_item(item).xyz;
                let hit = intersect_triangle(p, wall_item(item + 1u).xyz - p, wall_item(item + 2u).xyz - p, o, d);
                if hit.x > after && hit.x < best.distance {
                    best = WallHit(hit.x, item, hit.y, hit.z);
                }
            }
        }
        i += 1u;
        i >>= countTrailingZeros(i);
        if i <= 1u {
            break;
        }
    }
    return best;
}

// Returns a quantity at a hit, interpolated from its values at the corners.
fn at_wall(hit: WallHit, first: u32) -> vec3<f32> {
    let k = hit.item + first;
    return (1.0 - hit.u - hit.v) * wall_item(k).xyz + hit.u * wall_item(k + 1u).xyz + hit.v * wall_item(k + 2u).xyz;
}
