//! Values of the displayed field that are missing: NaN or infinite.

use crate::mesh::{Location, TetMesh};

/// Replaces each value that is not finite by the mean of those in the tets around it, or, where
/// those are missing too, by the lowest value. Returns what was done, if anything was.
///
/// # Errors
/// A clause for values none of which is finite.
pub(super) fn fill(
    mesh: &TetMesh,
    location: Location,
    values: &mut [f64],
) -> Result<Option<String>, String> {
    let is_missing: Vec<bool> = values.iter().map(|v| !v.is_finite()).collect();
    let missing = is_missing.iter().filter(|m| **m).count();
    let Some(first) = is_missing.iter().position(|m| *m) else {
        return Ok(None);
    };
    if missing == values.len() {
        return Err("must have finite values to be rendered, but has none".into());
    }
    let finite = values.iter().copied().filter(|v| v.is_finite());
    let lowest = finite.fold(f64::INFINITY, f64::min);
    // The sum of the finite values around each node, and their number.
    let mut around = vec![(0.0, 0.0); mesh.nodes.len()];
    for (t, tet) in mesh.tets.iter().enumerate() {
        let mut add = |v: u32, value: f64| {
            around[v as usize].0 += value;
            around[v as usize].1 += 1.0;
        };
        match location {
            Location::Cell if !is_missing[t] => tet.iter().for_each(|v| add(*v, values[t])),
            Location::Cell => {}
            Location::Node => {
                let lacking = tet.iter().filter(|v| is_missing[**v as usize]);
                for v in lacking {
                    let known = tet.iter().filter(|w| !is_missing[**w as usize]);
                    known.for_each(|w| add(*v, values[*w as usize]));
                }
            }
        }
    }
    let mean = |(sum, count): (f64, f64)| match count > 0.0 {
        true => sum / count,
        false => lowest,
    };
    for (i, value) in values
        .iter_mut()
        .enumerate()
        .filter(|(i, _)| is_missing[*i])
    {
        *value = mean(match location {
            Location::Node => around[i],
            Location::Cell => mesh.tets[i].iter().fold((0.0, 0.0), |(sum, count), v| {
                let (more, others) = around[*v as usize];
                (sum + more, count + others)
            }),
        });
    }
    let item = match location {
        Location::Node => "node",
        Location::Cell => "tet",
    };
    Ok(Some(match missing {
        1 => format!(
            "the value at {item} {first} is not a finite number; it is left out of the range and drawn as the mean around it"
        ),
        _ => format!(
            "the values at {missing} {item}s, the first of them {item} {first}, are not finite numbers; they are left out of the range and drawn as the means around them, or as the lowest value"
        ),
    }))
}
