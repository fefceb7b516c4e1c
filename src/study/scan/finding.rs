//! Findings of the scan study: charts and text.

use super::Sizes;
use super::subject::REFERENCE_SAMPLES_PER_VOXEL;
use crate::Result;
use crate::study::scaling::fit_exponent;
use crate::study::{Axis, Chart, Row, Run, Series, SeriesStyle};

/// Kinds of points, and their chart labels.
const NAMES: [(&str, &str); 3] = [
    ("cage", "the scan, in cages"),
    ("means", "means at the nodes"),
    ("samples", "samples at the nodes"),
];

/// Returns `[x, y]` of the points of one kind, sorted by tets.
fn curve(rows: &[Row], what: &str, [x, y]: [&str; 2]) -> Vec<[f64; 2]> {
    let mut own: Vec<&Row> = rows.iter().filter(|r| r.text("what") == what).collect();
    own.sort_by(|a, b| a.number("tets").total_cmp(&b.number("tets")));
    own.iter().map(|r| [r.number(x), r.number(y)]).collect()
}

/// Returns the y at which `points`, interpolated in logarithms, first reach `x`.
fn at(points: &[[f64; 2]], x: f64) -> Option<f64> {
    points.windows(2).find_map(|pair| {
        let [[x0, y0], [x1, y1]] = [pair[0], pair[1]];
        let share = (x / x0).ln() / (x1 / x0).ln();
        (0.0..=1.0)
            .contains(&share)
            .then(|| y0 * (y1 / y0).powf(share))
    })
}

/// Draws charts and reports.
pub(super) fn tell(run: &Run, sizes: &Sizes, rows: &[Row]) -> Result<()> {
    let is_reference =
        |r: &&Row| r.text("what") == "cage" && r.number("cells") == sizes.reference as f64;
    let reference = rows.iter().find(is_reference);
    let one = reference.map_or(f64::NAN, |r| r.number("nodes"));
    let time = format!("time a frame (1 = the cage of {one} nodes)");
    for (name, title, column, label) in [
        (
            "scan-time",
            "A scan in cages, and as values: error against time",
            "share",
            time.as_str(),
        ),
        (
            "scan-tets",
            "A scan in cages, and as values: error against tets",
            "tets",
            "tets",
        ),
    ] {
        let series = NAMES.map(|(what, name)| {
            let points = curve(rows, what, [column, "rmse_255"]);
            Series::new(name, SeriesStyle::LineMarks, points)
        });
        Chart {
            title: title.into(),
            x: Axis::log(label),
            y: Axis::log("RMSE (1/255)"),
            series: series.to_vec(),
        }
        .save(run.dir, name)?;
    }
    let n = sizes.voxels;
    let mut text = format!(
        "A scan of {n} × {n} × {n} voxels ({:.1} million) in a ball that is bent to a circular arc is rendered at {p} × {p} pixels: embedded in cages of a few tets and sampled at the rest position of each ray point, or stored at the nodes of fine meshes, as means over the nodes' cells or as samples at the nodes. The error is relative to the image of the scan bent without a mesh (float64, {} samples per voxel); R² is the fraction of that image's gradients that is reproduced. Time is that of a frame relative to the cage of {one} nodes, rendered alternately, the median of {} pairs. Memory is that of the mesh and the scan on the device.\n\n\
         | | nodes | tets | RMSE (1/255) | FLIP | R² of gradients | time | ms | MB |\n|---|---|---|---|---|---|---|---|---|",
        (n as f64).powi(3) / 1e6,
        REFERENCE_SAMPLES_PER_VOXEL,
        sizes.pairs,
        p = sizes.pixels,
    );
    for row in rows {
        let [nodes, tets, error, flip, r2, share, ms, mb] = [
            "nodes",
            "tets",
            "rmse_255",
            "flip",
            "gradient_r2",
            "share",
            "ms",
            "gpu_mb",
        ]
        .map(|column| row.number(column));
        text += &format!(
            "\n| {} | {nodes} | {tets} | {error:.2} | {flip:.4} | {r2:.3} | {share:.2} | {ms:.0} | {mb:.1} |",
            row.text("what")
        );
    }
    if let Some(reference) = reference {
        text += "\n\n";
        text += &compared(sizes, reference, rows);
    }
    let [few, many] = sizes.kept;
    let tets = |cells: usize| {
        let own = |r: &&Row| r.text("what") == "samples" && r.number("cells") == cells as f64;
        rows.iter().find(own).map_or(f64::NAN, |r| r.number("tets"))
    };
    text += &format!(
        "\n\n| exact scan | cage of {one} nodes | samples, {} tets | samples, {} tets |\n|---|---|---|---|\n| ![](scan-truth.png) | ![](scan-cage-{}.png) | ![](scan-samples-{few}.png) | ![](scan-samples-{many}.png) |",
        tets(few),
        tets(many),
        sizes.reference,
    );
    let title = "Scans in cages compared with nodal values";
    run.write_findings("scan", title, &text, &["scan-time", "scan-tets"])
}

/// Describes how many tets and how much time nodal values need for the error of the reference,
/// using the more accurate of means and samples.
fn compared(sizes: &Sizes, reference: &Row, rows: &[Row]) -> String {
    let (nodes, goal) = (reference.number("nodes"), reference.number("rmse_255"));
    let ends = ["means", "samples"].map(|what| {
        let last = curve(rows, what, ["tets", "rmse_255"]).last().copied();
        last.map(|last| (what, last))
    });
    let nearest = ends.into_iter().flatten();
    let Some((what, [most, least])) = nearest.min_by(|a, b| a.1[1].total_cmp(&b.1[1])) else {
        return String::new();
    };
    let of = |columns| curve(rows, what, columns);
    let million = |tets: f64| format!("{:.2} million", 1e-6 * tets);
    let tets = at(&of(["rmse_255", "tets"]), goal);
    let time = at(&of(["rmse_255", "share"]), goal);
    let mut text = match (tets, time) {
        (Some(tets), Some(time)) => format!(
            "Nodal values ({what}) reach the error of the cage of {nodes} nodes, {goal:.2}/255, at {} tets, in {time:.1} times its time per frame.",
            million(tets)
        ),
        _ => format!(
            "Nodal values ({what}, the more accurate ones) do not reach the error of the cage of {nodes} nodes, {goal:.2}/255: with {} tets, their error is {least:.2}/255, {:.1} times as large, in {:.2} times its time per frame.",
            million(most),
            least / goal,
            of(["share", "tets"]).last().map_or(f64::NAN, |p| p[0])
        ),
    };
    let better = curve(rows, "cage", ["nodes", "rmse_255"]);
    if let Some([nodes, error]) = better.iter().find(|p| p[1] < least) {
        text += &format!(
            " A cage of {nodes} nodes, {error:.2}/255, is more accurate than any of them."
        );
    }
    if let Some(power) = fit_exponent(&of(["tets", "rmse_255"])) {
        // For balls with as many cells across as the scan has voxels.
        let [cells, tets] = of(["cells", "tets"]).last().copied().unwrap_or_default();
        let voxelwise = tets * (sizes.voxels as f64 / cells).powi(3);
        text += &format!(
            " Their error scales as the power {power:.2} of the tets, over the larger half of the meshes; cells of voxel size would need {} tets.",
            million(voxelwise)
        );
    }
    if let Some(same) = at(&of(["share", "tets"]), 1.0)
        && let Some(error) = at(&of(["share", "rmse_255"]), 1.0)
    {
        text += &format!(
            " In the time of the cage, they have {} tets and {:.1} times its error.",
            million(same),
            error / goal
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curve_interpolates_as_power_law() {
        let falling = [[8.0, 10.0], [2.0, 1000.0], [1.0, 4000.0]];
        assert_eq!(at(&falling, 8.0), Some(10.0));
        let between = at(&falling, 4.0).unwrap_or(0.0);
        assert!((between - 100.0).abs() < 1e-9, "{between}");
        assert_eq!(at(&falling, 0.5), None);
        assert_eq!(at(&falling, 9.0), None);
    }
}
