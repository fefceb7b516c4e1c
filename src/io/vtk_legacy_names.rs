//! Names in VTK legacy files, which are single words.

/// Decodes a VTK name, with %XX for special characters.
pub(super) fn decoded(name: &str) -> String {
    let bytes = name.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let code = (bytes[i] == b'%')
            .then(|| name.get(i + 1..i + 3))
            .flatten()
            .and_then(|hex| u8::from_str_radix(hex, 16).ok());
        out.push(code.unwrap_or(bytes[i]));
        i += if code.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&out).into_owned()
}

/// Encodes a name as VTK does: %XX for special characters.
pub(super) fn encoded(name: &str) -> String {
    if name.is_empty() {
        return "%00".into();
    }
    name.bytes()
        .map(|b| match b {
            b'%' | b'"' => format!("%{b:02X}"),
            b'!'..=b'~' => char::from(b).to_string(),
            _ => format!("%{b:02X}"),
        })
        .collect()
}
