//! Exports the pipelines that scenes create on a GPU as SPIR-V, for `scripts/gpu-stats`.

use crate::support::gpu;
use base64::Engine as _;
use palpate::Error;
use palpate::gpu::{Gpu, PipelineDescription, Shaders};
use palpate::physics::{Engine, EngineChoice, SolverKind};
use palpate::scene::{Scene, Stage};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use wgpu::naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use wgpu::naga::{
    AddressSpace, Expression, ImageClass, Literal, Module, ShaderStage, TypeInner,
    back::pipeline_constants, back::spv, proc::BoundsCheckPolicies, proc::BoundsCheckPolicy,
};

/// Tets per mesh: pipelines do not depend on it.
const TETS: usize = 2000;

/// A box for the solvers and looks that no file of `data/scenes` has.
const BOX: &str =
    "[mesh]\ngenerate = \"box\"\ntets = 384\nunit = 1.0\n[[pin]]\naxis = \"z\"\nbelow = 0.01\n";

const TOOLS: &str =
    "[[tool]]\nsphere = { radius = 0.02 }\nat = [0.05, 0.05, 0.125]\nfriction = 0.3\n";

/// Writes into the file given by `PALPATE_PIPELINES` the pipelines that a GPU uses for the scenes of
/// `data/scenes`, in several looks, and for a box with each solver, as a JSON list.
#[test]
#[ignore = "for scripts/gpu-stats"]
fn pipelines_of_scenes_compile_to_spirv() {
    let Some(file) = std::env::var_os("PALPATE_PIPELINES") else {
        return;
    };
    let gpu = gpu().with_settings_of(wgpu::DeviceType::DiscreteGpu);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/scenes");
    let entries = std::fs::read_dir(&folder).unwrap();
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let mut failed = Vec::new();
    for path in files {
        let scene = Scene::read(&path).unwrap();
        // Some scenes need as many tets as they have.
        let made = prepare(&gpu, coarsened(&scene)).or_else(|_| prepare(&gpu, scene));
        failed.extend(made.err().map(|e| format!("{}: {e}", path.display())));
    }
    for text in box_scenes() {
        let made = Scene::parse(&text).and_then(|scene| prepare(&gpu, scene));
        failed.extend(made.err().map(|e| format!("{e}:\n{text}")));
    }
    for scene in path_scenes(&folder) {
        let made = scene.and_then(|scene| Stage::new(&gpu, &scene)?.start_paths([64, 64], true));
        failed.extend(made.err().map(|e| format!("light paths: {e}")));
    }
    let pipelines: Vec<Value> = gpu.pipelines_created().iter().map(exported).collect();
    std::fs::write(file, Value::from(pipelines).to_string()).unwrap();
    assert!(failed.is_empty(), "{failed:#?}");
}

/// Returns the box with each solver and material, on a floor, with a tool, and as a projection.
fn box_scenes() -> Vec<String> {
    let solver = |model: &str, solver: &str| {
        format!(
            "{BOX}[material]\nmodel = \"{model}\"\nyoung = 2e4\n[solver]\nname = \"{solver}\"\n\
             engine = \"gpu\"\n"
        )
    };
    let mut scenes = Vec::new();
    for model in ["springs", "neo-hookean", "corotated"] {
        let kinds = SolverKind::ALL.iter();
        scenes.extend(
            kinds.map(|kind| solver(model, kind.name()) + "[floor]\npoint = [0.0, 0.0, 0.0]\n"),
        );
    }
    scenes.push(solver("neo-hookean", "implicit") + TOOLS);
    let modes = ["thickness", "mip", "minip", "mean"];
    scenes.extend(modes.map(|mode| format!("{BOX}[picture]\nmode = \"{mode}\"\n")));
    scenes.push(format!("{BOX}[picture]\ntraversal = \"planes\"\n"));
    scenes
}

/// Returns scenes with light paths: of each kind of surface, of regions, and of a scan.
fn path_scenes(folder: &Path) -> Vec<palpate::Result<Scene>> {
    let planes = "[[plane]]\nclip = [0.05, 0.05, 0.05, 1, 0, 0]\n[[plane]]\nslice = [0.05, 0.05, 0.05, 0, 0, 1]\n";
    let looks = ["", TOOLS, planes, "[[isosurface]]\nvalue = 0.5\n"];
    let boxes = looks.map(|look| Scene::parse(&format!("{BOX}[light]\nmodel = \"path\"\n{look}")));
    let files = [
        ("head_ct.toml", ""),
        ("cheek_scan.toml", ""),
        ("cheek_scan.toml", "[[isosurface]]\nvalue = 700\n"),
    ];
    let files = files.map(|(file, more)| {
        let mut scene = coarsened(&Scene::read(folder.join(file))?);
        let look = Scene::parse(&format!("[light]\nmodel = \"path\"\n{more}"))?;
        (scene.light, scene.isosurface) = (look.light, look.isosurface);
        Ok(scene)
    });
    boxes.into_iter().chain(files).collect()
}

/// Creates the pipelines of a scene's steps and of its pictures: as they are, nearly opaque, unlit, with
/// shadows, cut by planes, and with an isosurface. Pictures are recorded but not submitted: a software driver would
/// compile all of their pipelines once more.
fn prepare(gpu: &Gpu, mut scene: Scene) -> palpate::Result<()> {
    scene.picture.size = Some([64, 64]);
    let mut stage = match Stage::new(gpu, &scene) {
        // Some bodies are too stiff for the precision of the GPU; their pictures use it.
        Err(Error::Input(reason)) if reason.contains("--engine cpu") => {
            scene.solver.engine = Some(EngineChoice::Exactly(Engine::Cpu));
            Stage::new(gpu, &scene)?
        }
        made => made?,
    };
    // The first step creates its passes; its result is not waited for.
    if stage.motion().is_some_and(|m| m.engine() == Engine::Gpu) {
        stage.request_steps(1)?;
    }
    record(gpu, &mut stage)?;
    stage.set_appearance(&opaque(&scene))?;
    record(gpu, &mut stage)?;
    for light in ["from = \"none\"", "shadows = 0.5"] {
        scene.light = Scene::parse(&format!("[light]\n{light}\n"))?.light;
        stage.set_appearance(&scene)?;
        record(gpu, &mut stage)?;
    }
    let (low, high) = stage.mesh().bounds();
    let [x, y, z] = (0.5 * (low + high)).to_array();
    scene.plane = Scene::parse(&format!(
        "[[plane]]\nclip = [{x}, {y}, {z}, 1, 0, 0]\n[[plane]]\nslice = [{x}, {y}, {z}, 0, 0, 1]\n"
    ))?
    .plane;
    stage.set_appearance(&scene)?;
    record(gpu, &mut stage)?;
    let (from, to) = stage.scalar_field().range;
    let value = 0.5 * (from + to);
    scene.isosurface = Scene::parse(&format!("[[isosurface]]\nvalue = {value}\n"))?.isosurface;
    // Values per tet and labels have no isosurfaces.
    if stage.set_appearance(&scene).is_ok() {
        record(gpu, &mut stage)?;
    }
    Ok(())
}

/// Returns a scene with segments so deep that the look-ups of the table are subdivided.
fn opaque(scene: &Scene) -> Scene {
    let dense = r#"{"colour": [[0, 1, 1, 1]], "extinction": [[0, 10000]]}"#;
    let mut scene = scene.clone();
    match &mut scene.scan[..] {
        [] => scene.picture.transfer = Some(dense.into()),
        scans => scans
            .iter_mut()
            .for_each(|scan| scan.transfer = Some(dense.into())),
    }
    scene
}

fn record(gpu: &Gpu, stage: &mut Stage) -> palpate::Result<()> {
    let picture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width: 64,
            height: 64,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    let view = picture.create_view(&wgpu::TextureViewDescriptor::default());
    stage.record(&mut gpu.start_recording(), &view)
}

/// Returns a scene with at most [`TETS`] tets a mesh.
fn coarsened(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    let bodies = scene.body.iter_mut().map(|body| &mut body.mesh);
    for mesh in bodies.chain([&mut scene.mesh]) {
        mesh.tets = mesh.tets.map(|tets| tets.min(TETS));
        for part in &mut mesh.join {
            part.tets = part.tets.map(|tets| tets.min(TETS));
        }
    }
    scene
}

/// Returns a pipeline with the SPIR-V of its stages, in base64, and the kinds of its bindings.
fn exported(pipeline: &PipelineDescription) -> Value {
    let name = &pipeline.shader;
    let module = Shaders::parse(name).unwrap();
    let info = Validator::new(ValidationFlags::all(), Capabilities::default())
        .validate(&module)
        .unwrap_or_else(|e| {
            panic!(
                "{name}: {}",
                e.emit_to_string(&Shaders::compose(name).unwrap())
            )
        });
    let used = |stage| match stage {
        ShaderStage::Compute => pipeline.targets.is_empty() && pipeline.depth.is_none(),
        _ => true,
    };
    let stages = module.entry_points.iter().filter(|e| used(e.stage));
    let stages: Vec<Value> = stages
        .map(|entry| {
            let code = spirv(&module, &info, pipeline, (entry.stage, &entry.name));
            let code: Vec<u8> = code.iter().flat_map(|word| word.to_le_bytes()).collect();
            json!({
                "stage": format!("{:?}", entry.stage).to_lowercase(),
                "entry": entry.name,
                "spirv": base64::engine::general_purpose::STANDARD.encode(code),
            })
        })
        .collect();
    let format = |format: &wgpu::TextureFormat| format!("{format:?}");
    json!({
        "shader": name,
        "constants": changed_constants(&module, pipeline),
        "stages": stages,
        "bindings": bindings(&module),
        "targets": pipeline.targets.iter().map(format).collect::<Vec<_>>(),
        "depth": pipeline.depth.as_ref().map(format),
    })
}

/// Returns the constants that differ from the shader's defaults.
fn changed_constants(module: &Module, pipeline: &PipelineDescription) -> BTreeMap<String, f64> {
    let default = |name: &str| {
        let mut overrides = module.overrides.iter().map(|(_, declared)| declared);
        let init = overrides.find(|o| o.name.as_deref() == Some(name))?.init?;
        match module.global_expressions[init] {
            Expression::Literal(Literal::Bool(x)) => Some(f64::from(u8::from(x))),
            Expression::Literal(Literal::U32(x)) => Some(f64::from(x)),
            Expression::Literal(Literal::F32(x)) => Some(f64::from(x)),
            _ => None,
        }
    };
    let constants = pipeline.constants.iter().cloned();
    // A default is in single precision.
    let differs = |(name, value): &(String, f64)| {
        default(name).is_none_or(|x| f64::from(x as f32) != f64::from(*value as f32))
    };
    constants.filter(differs).collect()
}

/// Translates one stage as wgpu does for a Vulkan driver with robust access to buffers and images.
fn spirv(
    module: &Module,
    info: &ModuleInfo,
    pipeline: &PipelineDescription,
    (stage, entry): (ShaderStage, &str),
) -> Vec<u32> {
    let name = &pipeline.shader;
    let constants = pipeline.constants.iter().cloned().collect();
    let (module, info) =
        pipeline_constants::process_overrides(module, info, Some((stage, entry)), &constants)
            .unwrap_or_else(|e| panic!("{name}: {e}"));
    let options = spv::Options {
        lang_version: (1, 6),
        flags: spv::WriterFlags::LABEL_VARYINGS | spv::WriterFlags::FORCE_POINT_SIZE,
        bounds_check_policies: BoundsCheckPolicies {
            index: BoundsCheckPolicy::Restrict,
            buffer: BoundsCheckPolicy::Unchecked,
            image_load: BoundsCheckPolicy::Unchecked,
            binding_array: BoundsCheckPolicy::Unchecked,
        },
        // As passes and draws request it.
        zero_initialize_workgroup_memory: spv::ZeroInitializeWorkgroupMemoryMode::None,
        force_loop_bounding: true,
        emit_int_div_checks: true,
        ..spv::Options::default()
    };
    let one = spv::PipelineOptions {
        shader_stage: stage,
        entry_point: entry.to_owned(),
    };
    spv::write_vec(&module, &info, &options, Some(&one)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn bindings(module: &Module) -> Vec<Value> {
    let globals = module.global_variables.iter().map(|(_, global)| global);
    let bound = globals.filter_map(|global| {
        let kind = match (&module.types[global.ty].inner, global.space) {
            (_, AddressSpace::Uniform) => "uniform",
            (_, AddressSpace::Storage { .. }) => "storage",
            (TypeInner::Sampler { .. }, _) => "sampler",
            (TypeInner::Image { class, .. }, _) => match class {
                ImageClass::Storage { .. } => "storage image",
                _ => "sampled image",
            },
            _ => return None,
        };
        Some(json!([global.binding?.binding, kind]))
    });
    bound.collect()
}
