// Tets and their faces. Matches `mesh::FACES`.

// No neighbour, or no face.
const NONE: u32 = 0xffffffffu;

// Returns the local corners of the face opposite corner f, counter-clockwise seen from outside.
fn face_corners(f: u32) -> vec3<u32> {
    switch f {
        case 0u: { return vec3(1u, 2u, 3u); }
        case 1u: { return vec3(0u, 3u, 2u); }
        case 2u: { return vec3(0u, 1u, 3u); }
        default: { return vec3(0u, 2u, 1u); }
    }
}
