// Common frame of both traversals: the ray of each pixel, its start and end, and retries of lost
// rays. Needs lib/array, lib/view, lib/tet, lib/ray_projection and lib/segment, and
// `traverse(code, ray, before) -> TraversalResult` of the importing shader, which traverses from
// boundary face `code` = 4 tet + face until the mesh or the ray ends.

// Whether rays run towards the eye from back faces, for an eye inside the mesh.
override BACKWARD_TRAVERSAL: bool = false;
// Whether opaque objects may end the rays.
override HAS_DEPTH: bool = false;
// Whether scalars are constant per tet.
override CELL_SCALARS: bool = false;

// Depth bits and 4 tet + face at the start of the rays of this layer.
@group(0) @binding(next) var starts: texture_2d<u32>;
// The nearest front faces, by which a backward traversal detects an eye inside the mesh.
@group(0) @binding(next) var fronts: texture_2d<u32>;
// Accumulated result of the previous layers.
@group(0) @binding(next) var gathered: texture_2d<f32>;
@group(0) @binding(next) var occluder: texture_depth_2d;
@group(0) @binding(next) var<storage, read_write> lost_ray_count: array<atomic<u32>, 1>;
// For the layers of this parity, the last one that has a face in each tile.
@group(0) @binding(next) var<storage, read> last_layers: array<u32>;
@group(0) @binding(next) var<uniform> params: View;

#import lib/tiles

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    if index < 3u {
        return fullscreen(index);
    }
    let tile = tile_of_vertex(index, textureDimensions(starts));
    return select(CULLED_POSITION, tile.corner, last_layers[tile.number] == tile.layer);
}

struct Ray {
    // In camera space.
    frame: RayFrame,
    // In the local frame: point(z) = origin + z direction.
    origin: vec3<f32>,
    direction: vec3<f32>,
    // If LIGHTING: the light vectors.
    lights: LightVectors,
    // Length of a unit step in z, in the unit of the mode.
    scale: f32,
    // z at the end of the ray.
    end: f32,
}

struct TraversalResult {
    sum: vec4<f32>,
    found: bool,
    // z at the beginning and end, the nearer first.
    depth_range: vec2<f32>,
}

fn pixel_ray(position: vec2<f32>) -> Ray {
    let frame = ray_frame(params, position);
    let slope = frame.slope;
    let plane_origin = frame.origin - vec2(params.right.w, params.up.w);
    let origin = plane_origin.x * params.right.xyz + plane_origin.y * params.up.xyz - params.forward.w * params.forward.xyz;
    let direction = slope.x * params.right.xyz + slope.y * params.up.xyz + params.forward.xyz;
    let length = sqrt(1.0 + dot(slope, slope));
    let scale = length * select(params.unit, params.opacity, INTEGRAND == COMPOSITE);
    return Ray(frame, origin, direction, light_vectors(params, direction / length), scale, 3e38);
}

// Returns a slightly displaced ray.
fn perturbed(ray: Ray) -> Ray {
    var other = ray;
    other.frame.origin += vec2(1.7e-6, -1.1e-6);
    other.origin += 1.7e-6 * params.right.xyz - 1.1e-6 * params.up.xyz;
    return other;
}

// Accumulates a segment of a backward traversal, clipped at the end of the ray.
fn accumulate_until_depth(sum: vec4<f32>, part: Segment, ray: Ray) -> vec4<f32> {
    var seen = part;
    if HAS_DEPTH {
        if part.front.z >= ray.end {
            return sum;
        }
        if part.back.z > ray.end {
            seen.back = lerp_sample(part.front, part.back, (ray.end - part.front.z) / (part.back.z - part.front.z));
        }
    }
    return accumulate_segment(sum, seen, ray);
}

// Traverses the mesh, and retries with perturbed rays if the traversal fails, which is possible for
// a ray exactly in a face or an edge. Counts the ray as lost if the retries fail too.
fn traverse_with_retry(code: u32, ray: Ray, before: vec4<f32>) -> TraversalResult {
    var along = ray;
    var walked = TraversalResult(before, false, vec2(0.0));
    for (var attempt = 0u; attempt < 4u && !walked.found; attempt++) {
        walked = traverse(code, along, before);
        along = perturbed(along);
    }
    if !walked.found {
        atomicAdd(&lost_ray_count[0], 1u);
    }
    return walked;
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<u32>(position.xy);
    let start = textureLoad(starts, pixel, 0).xy;
    var sum = vec4(0.0);
    var starting = start.y != NONE;
    if BACKWARD_TRAVERSAL {
        // The eye is inside the mesh if the nearest face is a back face.
        let front = textureLoad(fronts, pixel, 0).xy;
        starting = starting && (front.y == NONE || bitcast<f32>(start.x) >= bitcast<f32>(front.x));
    } else {
        sum = textureLoad(gathered, pixel, 0);
        starting = starting && !is_terminated(sum);
    }
    var ray = pixel_ray(position.xy);
    if HAS_DEPTH {
        ray.end = z_of_depth(params, textureLoad(occluder, pixel, 0));
        starting = starting && (BACKWARD_TRAVERSAL || z_of_depth(params, bitcast<f32>(start.x)) < ray.end);
    }
    if starting {
        if !BACKWARD_TRAVERSAL {
            sum = initial_accumulator(sum);
        }
        let earlier = sum;
#any intervals         sum = vec4(0.0);
        let walked = traverse_with_retry(start.y, ray, sum);
        sum = walked.sum;
#any intervals         append_segment(pixel, walked);
#any intervals         sum = earlier + (1.0 - earlier.a) * walked.sum;
    }
    return sum;
}
