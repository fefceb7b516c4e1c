//! Translates every composed shader as wgpu does on macOS and Windows, with the translators that run
//! there. Browsers and Vulkan are tested with their own compilers: `tint.rs`, and all other tests.

use palpate::gpu::Shaders;
use wgpu::naga::back::pipeline_constants::process_overrides;
use wgpu::naga::back::{PipelineConstants, hlsl, msl};
use wgpu::naga::front::wgsl;
use wgpu::naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use wgpu::naga::{Module, ShaderStage};

/// Metal's language from macOS 10.14 on, the first with `invariant`, by which both passes over a
/// surface get the same depths.
const METAL: (u8, u8) = (2, 1);

#[test]
fn composed_shaders_translate_to_metal_and_hlsl() {
    let mut wrong = Vec::new();
    for name in Shaders::names() {
        let module = Shaders::parse(&name).unwrap();
        for stage in Stage::all(&module, &Shaders::compose(&name).unwrap()) {
            let results = [
                ("Metal", stage.to_metal(METAL)),
                // The compiler of Windows itself, and the one that programs may bring.
                ("HLSL 5.1", stage.to_hlsl(hlsl::ShaderModel::V5_1)),
                ("HLSL 6.0", stage.to_hlsl(hlsl::ShaderModel::V6_0)),
            ];
            for (language, result) in results {
                match result {
                    Ok(text) => assert!(text.contains(&stage.entry), "{name}: {language}:\n{text}"),
                    Err(e) => wrong.push(format!("{name} {}: {language}: {e}", stage.entry)),
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn features_that_a_language_lacks_are_translation_errors() {
    let name = "render/start stored";
    let stages = Stage::all(
        &Shaders::parse(name).unwrap(),
        &Shaders::compose(name).unwrap(),
    );
    let vertex = stages.iter().find(|s| s.entry == "vertex").unwrap();
    vertex.to_metal(METAL).unwrap();
    let error = vertex.to_metal((2, 0)).unwrap_err();
    assert!(error.contains("invariant"), "{error}");

    let source = "@vertex fn main(@builtin(view_index) view: u32) -> @builtin(position) vec4<f32> {
        return vec4(f32(view));
    }";
    let stages = Stage::all(&wgsl::parse_str(source).unwrap(), source);
    stages[0].to_hlsl(hlsl::ShaderModel::V6_1).unwrap();
    let error = stages[0].to_hlsl(hlsl::ShaderModel::V5_1).unwrap_err();
    assert!(error.contains("shader model"), "{error}");
}

/// An entry point of a module whose overrides are replaced by their defaults.
struct Stage {
    kind: ShaderStage,
    entry: String,
    module: Module,
    info: ModuleInfo,
}

impl Stage {
    fn all(module: &Module, source: &str) -> Vec<Stage> {
        let capabilities = Capabilities::default() | Capabilities::MULTIVIEW;
        let info = Validator::new(ValidationFlags::all(), capabilities)
            .validate(module)
            .unwrap_or_else(|e| panic!("{}", e.emit_to_string(source)));
        let entries = module.entry_points.iter();
        entries
            .map(|entry| {
                let point = Some((entry.stage, entry.name.as_str()));
                let constants = PipelineConstants::default();
                let made = process_overrides(module, &info, point, &constants);
                let (module, info) = made.unwrap_or_else(|e| panic!("{}: {e}", entry.name));
                Stage {
                    kind: entry.stage,
                    entry: entry.name.clone(),
                    module: module.into_owned(),
                    info: info.into_owned(),
                }
            })
            .collect()
    }

    fn to_metal(&self, lang_version: (u8, u8)) -> Result<String, String> {
        let options = msl::Options {
            lang_version,
            ..msl::Options::default()
        };
        let pipeline = msl::PipelineOptions {
            entry_point: Some((self.kind, self.entry.clone())),
            ..msl::PipelineOptions::default()
        };
        let (text, made) = msl::write_string(&self.module, &self.info, &options, &pipeline)
            .map_err(|e| e.to_string())?;
        let names: Result<Vec<String>, _> = made.entry_point_names.into_iter().collect();
        names.map(|_| text).map_err(|e| e.to_string())
    }

    fn to_hlsl(&self, shader_model: hlsl::ShaderModel) -> Result<String, String> {
        let options = hlsl::Options {
            shader_model,
            ..hlsl::Options::default()
        };
        let pipeline = hlsl::PipelineOptions {
            entry_point: Some((self.kind, self.entry.clone())),
        };
        let mut text = String::new();
        let made = hlsl::Writer::new(&mut text, &options, &pipeline)
            .write(&self.module, &self.info, None)
            .map_err(|e| e.to_string())?;
        let names: Result<Vec<String>, _> = made.entry_point_names.into_iter().collect();
        names.map(|_| text).map_err(|e| e.to_string())
    }
}
