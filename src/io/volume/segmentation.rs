//! Segmentations of 3D Slicer in NRRD: names, labels and colours of segments, and their layers.
//!
//! Segments that overlap are in several layers, the values of a non-spatial axis. The keys are
//! described at slicer.readthedocs.io (developer guide, Segmentations).

use crate::volume::{Raw, Volume};
use std::collections::{BTreeMap, HashMap};

/// Maximum number of pairs of overlapping segments that are listed.
const MAX_LISTED: usize = 12;

/// A segment of a file.
pub(super) struct Segment {
    /// Number from the keys, by which segments are ordered.
    number: usize,
    layer: usize,
    value: i64,
    name: Option<String>,
    colour: Option<[f64; 3]>,
}

impl Segment {
    /// Returns its name for messages.
    fn called(&self) -> String {
        let name = self.name.clone();
        name.unwrap_or_else(|| format!("segment {}", self.number))
    }
}

/// Returns the segments that the key/value pairs of a file of `layers` layers describe.
pub(super) fn segments(pairs: &[(String, String)], layers: usize) -> Vec<Segment> {
    let mut keys: BTreeMap<usize, HashMap<&str, &str>> = BTreeMap::new();
    for (key, value) in pairs {
        let split = key.strip_prefix("Segment").and_then(|k| k.split_once('_'));
        if let Some((number, key)) = split
            && let Ok(number) = number.parse()
        {
            keys.entry(number).or_default().insert(key, value);
        }
    }
    let in_order = keys.into_iter().enumerate();
    let all = in_order.map(|(place, (number, keys))| {
        let whole = |key: &str| keys.get(key).and_then(|v| v.trim().parse::<i64>().ok());
        let value = whole("LabelValue");
        // Before Slicer 4.11 each segment had a layer of its own, with the value 1.
        let own = if value.is_none() && layers > 1 {
            place
        } else {
            0
        };
        let layer = whole("Layer").map_or(own, |l| usize::try_from(l).unwrap_or(usize::MAX));
        let text = |key: &str| keys.get(key).map(|v| v.trim()).filter(|v| !v.is_empty());
        let colour: Option<Vec<f64>> = text("Color").and_then(|colour| {
            let channel = |w: &str| w.parse().ok().filter(|c| (0.0..=1.0).contains(c));
            colour.split_whitespace().map(channel).collect()
        });
        Segment {
            number,
            layer,
            value: value.unwrap_or(1),
            name: text("Name").or(text("ID")).map(str::to_owned),
            colour: colour.and_then(|c| c.try_into().ok()),
        }
    });
    all.filter(|segment| segment.layer < layers).collect()
}

/// Returns `volume`, which is layer `layer`, with the names and colours of its labels.
pub(super) fn named(mut volume: Volume, segments: &[Segment], layer: usize) -> Volume {
    for segment in segments.iter().filter(|s| s.layer == layer) {
        set(&mut volume, segment.value, segment);
    }
    volume
}

fn set(volume: &mut Volume, label: i64, segment: &Segment) {
    if let Some(name) = &segment.name {
        volume.label_names.insert(label, name.clone());
    }
    if let Some(colour) = segment.colour {
        volume.label_colours.insert(label, colour);
    }
}

/// Returns `volume` with the labels of all layers, which `layer` returns. Labels keep their values
/// where they differ; where segments overlap, the last one remains, as in exports of 3D Slicer.
pub(super) fn merged(
    mut volume: Volume,
    segments: &[Segment],
    layers: usize,
    layer: impl Fn(usize) -> Raw,
) -> Volume {
    let labels = Labels::of(segments);
    for (segment, label) in segments.iter().zip(&labels.own) {
        set(&mut volume, *label, segment);
    }
    // The rank of the segment in each voxel, from 1; unnamed values follow the segments.
    let mut ranks = vec![0u32; volume.voxels()];
    let mut unnamed: Vec<(usize, i64)> = Vec::new();
    let mut overlaps: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    for n in 0..layers {
        let raw = layer(n);
        let mut rank_of: HashMap<i64, u32> = (1..)
            .zip(segments)
            .filter(|(_, s)| s.layer == n)
            .map(|(rank, s)| (s.value, rank))
            .collect();
        // Values occur in runs.
        let (mut last, mut own) = (0, 0);
        for (voxel, rank) in ranks.iter_mut().enumerate() {
            let value = raw.get(voxel) as i64;
            if value == 0 {
                continue;
            }
            if value != last {
                own = *rank_of.entry(value).or_insert_with(|| {
                    unnamed.push((n, value));
                    (segments.len() + unnamed.len()) as u32
                });
                last = value;
            }
            if *rank != 0 {
                let pair = [own.min(*rank), own.max(*rank)];
                *overlaps.entry(pair).or_insert(0) += 1;
            }
            *rank = own.max(*rank);
        }
    }
    let mut next = labels.next;
    let mut by_rank = vec![0];
    by_rank.extend(&labels.own);
    let more = unnamed.iter().map(|_| {
        next += 1;
        next - 1
    });
    by_rank.extend(more);
    let all = ranks.iter().map(|rank| by_rank[*rank as usize]);
    volume.raw = Raw::of_labels(all, by_rank.iter().copied());
    volume.notes.extend(labels.note(segments, layers));
    volume
        .notes
        .extend(overlap_note(segments, &overlaps, &by_rank));
    volume
}

/// The labels of segments.
struct Labels {
    own: Vec<i64>,
    /// The first label above all of them.
    next: i64,
}

impl Labels {
    fn of(segments: &[Segment]) -> Labels {
        let values = segments.iter().map(|s| s.value);
        let mut next = values.fold(0, i64::max).saturating_add(1);
        let mut taken = Vec::new();
        for segment in segments {
            let free = segment.value != 0 && !taken.contains(&segment.value);
            taken.push(if free {
                segment.value
            } else {
                next = next.saturating_add(1);
                next - 1
            });
        }
        Labels { own: taken, next }
    }

    /// Says which labels differ from the values in the file.
    fn note(&self, segments: &[Segment], layers: usize) -> Option<String> {
        let changed: Vec<String> = segments
            .iter()
            .zip(&self.own)
            .filter(|(s, label)| s.value != **label)
            .map(|(s, label)| {
                let (name, value, layer) = (s.called(), s.value, s.layer);
                format!("{name} is label {label} (value {value} of layer {layer})")
            })
            .collect();
        let listed = changed.iter().take(MAX_LISTED).cloned().collect::<Vec<_>>();
        (!changed.is_empty()).then(|| {
            format!(
                "{layers} layers of segments were merged to one label map: {}{}",
                listed.join(", "),
                more(changed.len())
            )
        })
    }
}

fn more(count: usize) -> String {
    match count.saturating_sub(MAX_LISTED) {
        0 => String::new(),
        n => format!(" and {n} more"),
    }
}

/// Says which segments overlap, in how many voxels.
fn overlap_note(
    segments: &[Segment],
    overlaps: &BTreeMap<[u32; 2], usize>,
    by_rank: &[i64],
) -> Option<String> {
    let name = |rank: u32| match segments.get(rank as usize - 1) {
        Some(segment) => segment.called(),
        None => format!("label {}", by_rank[rank as usize]),
    };
    let pairs = overlaps
        .iter()
        .take(MAX_LISTED)
        .map(|([below, above], voxels)| {
            format!("{} over {} in {voxels} voxels", name(*above), name(*below))
        });
    let pairs: Vec<String> = pairs.collect();
    (!pairs.is_empty()).then(|| {
        format!(
            "segments overlap, and the last one remains: {}{}; read one layer with --volume",
            pairs.join(", "),
            more(overlaps.len())
        )
    })
}
