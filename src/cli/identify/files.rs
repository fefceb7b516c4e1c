//! Files of an identification, and the steps from which an interrupted one goes on.

use palpate::identify::{Experiment, Identified, IdentifyOptions, IdentifyStep, Residual};
use palpate::io::atomic_write;
use palpate::scene::Scene;
use palpate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Steps of a search that is not complete.
pub struct Steps {
    path: PathBuf,
    kept: KeptSteps,
}

#[derive(Serialize, Deserialize)]
struct KeptSteps {
    /// Fingerprint of the scene, data and unknowns.
    mark: String,
    /// The last step of each start.
    steps: Vec<IdentifyStep>,
}

impl Steps {
    /// Opens `steps.json` in a folder; without those of this search it is empty.
    pub fn open(
        out: &Path,
        (scene, data): (&Scene, &[Experiment]),
        options: &IdentifyOptions,
    ) -> Steps {
        let mark = format!("{:016x}", options.fingerprint(scene, data));
        let path = out.join("steps.json");
        let text = std::fs::read_to_string(&path).ok();
        let kept = text.and_then(|text| serde_json::from_str::<KeptSteps>(&text).ok());
        Steps {
            path,
            kept: kept.filter(|kept| kept.mark == mark).unwrap_or(KeptSteps {
                mark,
                steps: Vec::new(),
            }),
        }
    }

    /// The last step of each start.
    pub fn last(&self) -> &[IdentifyStep] {
        &self.kept.steps
    }

    /// Keeps a step.
    pub fn keep(&mut self, step: &IdentifyStep) -> Result<()> {
        self.kept.steps.retain(|own| own.start != step.start);
        self.kept.steps.push(step.clone());
        let text = serde_json::to_string_pretty(&self.kept);
        let text = text.map_err(|e| Error::Input(format!("steps.json: {e}")))?;
        atomic_write(&self.path, |file| {
            writeln!(file, "{text}").map_err(Error::io(&self.path))
        })
    }

    /// Removes the file of a search that is complete.
    pub fn remove(self) -> Result<()> {
        match std::fs::remove_file(&self.path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io(&self.path)(e)),
            _ => Ok(()),
        }
    }
}

/// Writes `identified.json`.
pub fn write_json(out: &Path, found: &Identified) -> Result<()> {
    let path = out.join("identified.json");
    atomic_write(&path, |file| {
        let text = serde_json::to_string_pretty(found);
        let text = text.map_err(|e| Error::Input(format!("identified.json: {e}")))?;
        writeln!(file, "{text}").map_err(Error::io(&path))
    })
}

/// Writes `residuals.csv`.
pub fn write_residuals(out: &Path, residuals: &[Residual]) -> Result<()> {
    let path = out.join("residuals.csv");
    atomic_write(&path, |file| {
        let mut text =
            String::from("experiment,quantity,x,y,z,depth_m,measured,predicted,residual\n");
        for row in residuals {
            let [x, y, z] = row.at;
            text += &format!(
                "\"{}\",{},{x},{y},{z},{},{},{},{}\n",
                row.experiment.replace('"', "\"\""),
                row.quantity,
                row.depth_m,
                row.measured,
                row.predicted,
                row.residual
            );
        }
        file.write_all(text.as_bytes()).map_err(Error::io(&path))
    })
}
