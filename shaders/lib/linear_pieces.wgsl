// Piecewise linear transfer function: colour and extinction are linear in each piece. Scalars and
// extinction are normalised to the range from 0 to 1.

struct Piece {
    // Scalar and extinction at the two ends.
    ends: vec4<f32>,
    first: vec4<f32>,
    last: vec4<f32>,
}

// Integrals over the part of a piece between two scalars: (integrated colour, width) and
// (integrated colour times extinction, integrated extinction). Exact: the integrands are quadratic
// at most.
struct Part {
    colour: vec4<f32>,
    emission: vec4<f32>,
}

fn part(piece: Piece, low: f32, high: f32) -> Part {
    let a = max(low, piece.ends.x);
    let b = min(high, piece.ends.z);
    let width = b - a;
    if !(width > 0.0) {
        return Part(vec4(0.0), vec4(0.0));
    }
    let run = 1.0 / (piece.ends.z - piece.ends.x);
    let u = (a - piece.ends.x) * run;
    let v = (b - piece.ends.x) * run;
    let ca = mix(piece.first.rgb, piece.last.rgb, u);
    let cb = mix(piece.first.rgb, piece.last.rgb, v);
    let ta = mix(piece.ends.y, piece.ends.w, u);
    let tb = mix(piece.ends.y, piece.ends.w, v);
    let middle = 0.25 * (ca + cb) * (ta + tb);
    let emitted = width / 6.0 * (ca * ta + 4.0 * middle + cb * tb);
    return Part(vec4(0.5 * width * (ca + cb), width), vec4(emitted, 0.5 * width * (ta + tb)));
}
