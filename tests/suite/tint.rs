//! Exports every composed shader for `scripts/tint`, which passes them to a browser's compiler.

use palpate::gpu::Shaders;
use serde_json::{Value, json};
use wgpu::naga::{
    Binding, BuiltIn, GlobalVariable, Handle, ImageClass, Module, ScalarKind, ShaderStage,
    TypeInner,
};

/// Writes them as JSON into the file given by `PALPATE_SHADERS`, with the parameters of a pipeline:
/// entry points, formats of targets, and the values of override constants to be tested.
#[test]
fn composed_shaders_have_the_parameters_of_a_pipeline() {
    let shaders = composed().unwrap();
    assert_eq!(shaders.len(), Shaders::names().count());
    for shader in &shaders {
        let source = shader["source"].as_str().unwrap();
        assert!(!source.contains("#import"), "{shader}");
        // A pipeline without targets computes or writes depths.
        let draws = shader["targets"] != json!([]);
        assert!(!(draws && shader["compute"] == true), "{shader}");
        assert!(draws || shader["depth"] == true, "{shader}");
        // Every constant with a value of its own is tested.
        let tested = shader["overrides"].as_array().unwrap().len();
        let declared =
            source.matches("override ").count() - source.matches("override WORKGROUP").count();
        assert_eq!(tested, declared, "{shader}");
    }
    if let Some(file) = std::env::var_os("PALPATE_SHADERS") {
        std::fs::write(file, Value::Array(shaders).to_string()).unwrap();
    }
}

/// Software drivers lend more storage textures to light paths only: all others stay within WebGPU's limits.
#[test]
fn shaders_bind_no_more_storage_textures_than_webgpu_has() {
    let mut most = 0;
    for name in Shaders::names() {
        let module = Shaders::parse(&name).unwrap();
        let is_storage = |(_, own): &(Handle<GlobalVariable>, &GlobalVariable)| {
            matches!(
                module.types[own.ty].inner,
                TypeInner::Image {
                    class: ImageClass::Storage { .. },
                    ..
                }
            )
        };
        let count = module.global_variables.iter().filter(is_storage).count();
        most = most.max(count);
        let limit = if name.starts_with("render/path stored") {
            8
        } else {
            4
        };
        assert!(count <= limit, "{name}: {count}");
    }
    assert!(most > 4, "{most}");
}

fn composed() -> palpate::Result<Vec<Value>> {
    Shaders::names()
        .map(|name| {
            let module = Shaders::parse(&name)?;
            Ok(json!({
                "name": name,
                "source": Shaders::compose(&name)?,
                "compute": module.entry_points.iter().any(|e| e.stage == ShaderStage::Compute),
                "targets": targets(&module),
                "depth": writes_depth(&module),
                "overrides": overrides(&module),
            }))
        })
        .collect()
}

/// Returns the bindings and types of the outputs of the fragment stage.
fn outputs(module: &Module) -> Vec<(Binding, &TypeInner)> {
    let fragment = |e: &&wgpu::naga::EntryPoint| e.stage == ShaderStage::Fragment;
    let result = module
        .entry_points
        .iter()
        .find(fragment)
        .and_then(|e| e.function.result.as_ref());
    let Some(result) = result else {
        return Vec::new();
    };
    let inner = &module.types[result.ty].inner;
    match (&result.binding, inner) {
        (Some(binding), inner) => vec![(binding.clone(), inner)],
        (None, TypeInner::Struct { members, .. }) => members
            .iter()
            .filter_map(|m| Some((m.binding.clone()?, &module.types[m.ty].inner)))
            .collect(),
        (None, _) => Vec::new(),
    }
}

fn targets(module: &Module) -> Vec<&'static str> {
    let format = |inner: &TypeInner| match (inner.scalar_kind(), inner.components()) {
        (Some(ScalarKind::Uint), Some(4)) => "rgba32uint",
        (Some(ScalarKind::Uint), Some(2)) => "rg32uint",
        (Some(ScalarKind::Uint), _) => "r32uint",
        _ => "rgba16float",
    };
    outputs(module)
        .iter()
        .filter(|(binding, _)| matches!(binding, Binding::Location { .. }))
        .map(|(_, inner)| format(inner))
        .collect()
}

/// Whether the fragment stage writes depths, or only those of its triangles.
fn writes_depth(module: &Module) -> bool {
    let depth = |b: &Binding| matches!(b, Binding::BuiltIn(BuiltIn::FragDepth));
    targets(module).is_empty() || outputs(module).iter().any(|(b, _)| depth(b))
}

/// Returns each override constant with its test values, one constant at a time: both of a flag, the
/// first numbers of a choice.
fn overrides(module: &Module) -> Vec<Value> {
    let values = |inner: &TypeInner| match inner.scalar_kind() {
        Some(ScalarKind::Bool) => vec![0, 1],
        Some(ScalarKind::Uint) => vec![1, 2],
        _ => vec![1],
    };
    module
        .overrides
        .iter()
        .filter(|(_, o)| o.name.as_deref() != Some("WORKGROUP"))
        .map(|(_, o)| json!({ "name": o.name, "values": values(&module.types[o.ty].inner) }))
        .collect()
}
