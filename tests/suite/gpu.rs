//! The pass mechanism on a real adapter (a software one suffices; without any, these tests fail).

use palpate::gpu::{Gpu, GpuStruct, Shaders, Texel, check_layout};
use palpate::{Error, gpu_struct};
use std::collections::BTreeSet;

/// Texels per row of arrays.
const ROW_TEXELS: u32 = 8192;

gpu_struct! {
    struct Scale {
        items: u32,
        factor: f32,
    }
}

#[test]
fn composed_shaders_are_valid() {
    use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};
    // Every program in `shaders/` is among them.
    let named: BTreeSet<String> = Shaders::names()
        .map(|name| name.split(' ').next().unwrap().to_owned())
        .collect();
    let mut files = BTreeSet::new();
    for folder in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders")).unwrap() {
        let folder = folder.unwrap().path();
        let of = folder.file_name().unwrap().to_str().unwrap();
        if ["lib", "terms"].contains(&of) || !folder.is_dir() {
            continue;
        }
        for file in std::fs::read_dir(&folder).unwrap() {
            let file = file.unwrap().path();
            files.insert(format!(
                "{of}/{}",
                file.file_stem().unwrap().to_str().unwrap()
            ));
        }
    }
    assert_eq!(named, files);
    for name in Shaders::names() {
        let module = Shaders::parse(&name).unwrap_or_else(|e| panic!("{e}"));
        Validator::new(ValidationFlags::all(), Capabilities::default())
            .validate(&module)
            .unwrap_or_else(|e| {
                panic!(
                    "{name}: {}",
                    e.emit_to_string(&Shaders::compose(&name).unwrap())
                )
            });
    }
}

#[test]
fn composed_terms_declare_their_bindings() {
    let declared = |name: &str| -> Vec<String> {
        let module = Shaders::parse(name).unwrap();
        let globals = module.global_variables.iter().map(|(_, g)| g);
        let bound = globals.filter_map(|g| Some((g.binding?.binding, g.name.clone()?)));
        let mut bound: Vec<(u32, String)> = bound.collect();
        bound.sort();
        assert!(
            (0..).zip(&bound).all(|(k, b)| k == b.0),
            "{name}: {bound:?}"
        );
        bound.into_iter().map(|b| b.1).collect()
    };
    let own = declared("physics/forces springs");
    assert_eq!(own[8..], ["rows", "columns", "springs", "spring_params"]);
    let more = declared("physics/forces springs floor");
    assert_eq!(more[..12], own[..]);
    assert_eq!(more[12..], ["node_terms"]);
    let solve = declared("physics/implicit_euler_direction elements");
    assert_eq!(solve[11..], ["rows", "columns", "matrix"]);
    for wrong in ["physics/forces sprigs", "physics/farces springs"] {
        assert!(
            matches!(Shaders::compose(wrong), Err(Error::Gpu(_))),
            "{wrong}"
        );
    }
}

#[test]
fn layout_check_rejects_reordered_members() {
    mod wrong {
        palpate::gpu_struct! { pub struct Scale { factor: f32, items: u32 } }
    }
    check_layout::<Scale>("gpu/scale").unwrap();
    let error = check_layout::<wrong::Scale>("gpu/scale").unwrap_err();
    assert!(error.to_string().contains("factor"), "{error}");
    assert_eq!(Scale::MEMBERS[1], ("factor", 4));
}

#[test]
fn pass_covers_all_items_in_recorded_order() {
    let gpu = Gpu::new().unwrap();
    // One item past a texture row, one past 65,535 workgroups of 64.
    for items in [1usize, 8193, 65_535 * 64 + 1] {
        let input: Vec<[f32; 4]> = (0..items).map(|i| [i as f32, 1.0, 2.0, -3.0]).collect();
        let a = gpu.array_of("a", Texel::F32x4, &input).unwrap();
        let b = gpu.array("b", Texel::F32x4, items).unwrap();
        let scale = |from, to, factor| {
            let params = Scale {
                items: items as u32,
                factor,
            };
            gpu.pass("gpu/scale")
                .read(from)
                .write(to)
                .params(&params)
                .dispatch_items(items as u32)
                .unwrap()
        };
        let forth = scale(&a, &b, 2.0);
        let back = scale(&b, &a, -1.0);
        let mut work = gpu.start_recording();
        forth.record(&mut work);
        back.record(&mut work);
        work.submit().unwrap();
        let before = gpu.readbacks();
        let result: Vec<[f32; 4]> = gpu.read_array(&a).unwrap();
        assert_eq!(gpu.readbacks(), before + 1);
        assert_eq!(result.len(), items);
        assert!(
            result
                .iter()
                .zip(&input)
                .all(|(r, i)| *r == i.map(|x| -2.0 * x))
        );
    }
}

#[test]
fn rejects_bindings_that_mismatch_shader() {
    let gpu = Gpu::new().unwrap();
    let a = gpu.array("a", Texel::F32x4, 8).unwrap();
    let b = gpu.array("b", Texel::F32x4, 8).unwrap();
    let narrow = gpu.array("narrow", Texel::F32, 8).unwrap();
    let p = Scale {
        items: 8,
        factor: 1.0,
    };
    let refusals = [
        gpu.pass("gpu/scale").read(&a).write(&b).dispatch_items(8),
        gpu.pass("gpu/scale")
            .write(&a)
            .read(&b)
            .params(&p)
            .dispatch_items(8),
        gpu.pass("gpu/scale")
            .read(&a)
            .write(&a)
            .params(&p)
            .dispatch_items(8),
        gpu.pass("gpu/scale")
            .read(&a)
            .write(&narrow)
            .params(&p)
            .dispatch_items(8),
        gpu.pass("gpu/nowhere").read(&a).dispatch_items(8),
    ];
    for refusal in refusals {
        assert!(matches!(refusal, Err(Error::Gpu(_))), "{refusal:?}");
    }
}

#[test]
fn unknown_adapter_error_lists_available_adapters() {
    let error = Gpu::with_adapter(Some("no such card"))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("no such card") && error.contains("0: "),
        "{error}"
    );
}

#[test]
fn passes_are_timed_if_adapter_supports_timestamps() {
    let gpu = Gpu::new().unwrap();
    let a = gpu.array("a", Texel::F32x4, 100_000).unwrap();
    let b = gpu.array("b", Texel::F32x4, 100_000).unwrap();
    let p = Scale {
        items: 100_000,
        factor: 1.0,
    };
    let pass = gpu
        .pass("gpu/scale")
        .read(&a)
        .write(&b)
        .params(&p)
        .dispatch_items(100_000)
        .unwrap();
    gpu.time_passes(true);
    let mut work = gpu.start_recording();
    pass.record(&mut work);
    work.submit().unwrap();
    let times = gpu.timings().unwrap();
    if gpu.has(wgpu::Features::TIMESTAMP_QUERY) {
        // A coarse clock may give 0.
        assert!(times["gpu/scale"] >= 0.0);
    } else {
        assert!(times.is_empty());
    }
}

#[test]
fn external_device_is_used_unchanged() {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter =
        pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))
            .unwrap();
    let (device, queue) =
        pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap();
    let gpu = Gpu::from_wgpu(&adapter, device, queue);
    let a = gpu.array_of("a", Texel::F32x4, &[[1.0f32; 4]; 3]).unwrap();
    let b = gpu.array("b", Texel::F32x4, 3).unwrap();
    let p = Scale {
        items: 3,
        factor: 5.0,
    };
    let pass = gpu
        .pass("gpu/scale")
        .read(&a)
        .write(&b)
        .params(&p)
        .dispatch_items(3)
        .unwrap();
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    pass.record(&mut palpate::gpu::Recorder::with_encoder(
        &gpu,
        &mut encoder,
    ));
    gpu.queue().submit([encoder.finish()]);
    assert_eq!(gpu.read_array::<[f32; 4]>(&b).unwrap(), vec![[5.0; 4]; 3]);
}

#[test]
fn texture_load_count_includes_loops_and_calls() {
    Shaders::add(
        "suite/loads",
        "
@group(0) @binding(0) var a: texture_2d<f32>;
@group(0) @binding(1) var<storage, read_write> out: array<f32>;

fn twice(k: i32) -> f32 {
    return textureLoad(a, vec2(k, 0), 0).x + textureLoad(a, vec2(k, 1), 0).x;
}

@compute @workgroup_size(1)
fn main() {
    var sum = textureLoad(a, vec2(0, 0), 0).y;
    for (var k = 0; k < 7; k++) {
        if k > 3 {
            sum += twice(k);
        } else {
            sum -= textureLoad(a, vec2(k, 2), 0).z;
        }
    }
    out[0] = sum;
}
",
    )
    .unwrap();
    assert_eq!(Shaders::texture_loads("suite/loads").unwrap(), [1, 3]);
    assert!(Shaders::texture_loads("suite/nowhere").is_err());
    // Nodes are the outer loop of the pass, their springs an inner one; an additional term needs
    // none.
    let bare = Shaders::texture_loads("physics/forces springs").unwrap();
    assert_eq!(
        bare,
        Shaders::texture_loads("physics/forces springs floor").unwrap()
    );
    assert!(
        bare[0] == 0 && bare[1] > 0 && bare[2..].iter().sum::<u32>() > 2,
        "{bare:?}"
    );
}

#[test]
fn async_readback_completes_without_blocking() {
    let gpu = Gpu::new().unwrap();
    let content: Vec<u32> = (0..5_000).collect();
    let array = gpu.array_of("requested", Texel::U32, &content).unwrap();
    assert!(gpu.read_array_async::<[u32; 4]>(&array).is_err());
    let before = gpu.readbacks();
    let mut pending = gpu.read_array_async::<u32>(&array).unwrap();
    // Writes after the request are not visible.
    gpu.write_items(&array, 0, &[9u32]).unwrap();
    let found = (0..120_000).find_map(|_| {
        std::thread::sleep(std::time::Duration::from_millis(1));
        pending.try_take().unwrap()
    });
    assert_eq!(found.unwrap(), content);
    assert_eq!(gpu.readbacks(), before);
    assert!(pending.try_take().is_err());
    assert_eq!(gpu.read_array::<u32>(&array).unwrap()[0], 9);
}

#[test]
fn partial_array_writes_and_growth_preserve_content() {
    let gpu = Gpu::new().unwrap();
    // Within a row, across two, and over full rows with a partial row at either end.
    for (len, first, count) in [(100, 3, 50), (10_000, 8_100, 200), (30_000, 8_191, 17_000)] {
        let mut expected: Vec<[f32; 2]> = (0..len).map(|i| [i as f32, 0.5]).collect();
        let array = gpu.array_of("a", Texel::F32x2, &expected).unwrap();
        let part: Vec<[f32; 2]> = (0..count).map(|i| [-(i as f32), 2.0]).collect();
        gpu.write_items(&array, first as u32, &part).unwrap();
        expected[first..first + count].copy_from_slice(&part);
        assert_eq!(gpu.read_array::<[f32; 2]>(&array).unwrap(), expected);
        assert!(
            gpu.write_items(&array, (len - count + 1) as u32, &part)
                .is_err()
        );
    }
    let content: Vec<u32> = (0..8_000).collect();
    let mut array = gpu.array_of("b", Texel::U32, &content).unwrap();
    assert!(!gpu.resize(&mut array, "b", 8_192).unwrap());
    assert!(gpu.resize(&mut array, "b", 8_193).unwrap());
    assert_eq!((array.len(), array.capacity()), (8_193, 16_384));
    gpu.write_items(&array, 8_192, &[7u32]).unwrap();
    let found = gpu.read_array::<u32>(&array).unwrap();
    assert_eq!((&found[..8_000], found[8_192]), (&content[..], 7));
}

#[test]
fn device_has_webgpu_default_limits() {
    let gpu = Gpu::new().unwrap();
    let limits = gpu.device().limits();
    assert_eq!(limits.max_texture_dimension_2d, 8_192);
    assert_eq!(limits.max_texture_array_layers, 256);
    assert_eq!(limits.max_buffer_size, 256 << 20);
    assert_eq!(limits.max_storage_buffer_binding_size, 128 << 20);
    assert_eq!(limits.max_sampled_textures_per_shader_stage, 16);
    // Light paths read up to 8 on software drivers.
    let most = match gpu.adapter().device_type {
        wgpu::DeviceType::Cpu => 8,
        _ => 4,
    };
    assert!((4..=most).contains(&limits.max_storage_textures_per_shader_stage));
    assert_eq!(limits.max_storage_buffers_per_shader_stage, 8);
    assert_eq!(limits.max_compute_workgroups_per_dimension, 65_535);
    // The largest array is the largest texture.
    assert_eq!(gpu.max_items(), 8_192 * 8_192);
    let error = gpu.array("a", Texel::F32, gpu.max_items() + 1).unwrap_err();
    assert!(error.to_string().contains("67108864"), "{error}");
}

#[test]
fn arrays_of_any_length_round_trip_copy_and_grow() {
    let gpu = Gpu::new().unwrap();
    for len in [1, 255, 256, 257, 8_191, 8_192, 8_193, 20_001] {
        let content: Vec<[u32; 2]> = (0..len).map(|i| [i, 7 * i]).collect();
        let array = gpu.array_of("a", Texel::U32x2, &content).unwrap();
        let [width, rows] = [array.texture().width(), array.texture().height()];
        // A full row only if there are several.
        assert!(width * rows < len + ROW_TEXELS && (rows == 1 || width == ROW_TEXELS));
        assert!(rows > 1 || width < len + 256, "{len}: {width}");
        assert_eq!(gpu.read_array::<[u32; 2]>(&array).unwrap(), content);
        let roomy = gpu
            .array_with_headroom("roomy", Texel::U32x2, len as usize)
            .unwrap();
        let mut back = gpu.array("back", Texel::U32x2, len as usize).unwrap();
        let mut work = gpu.start_recording();
        work.copy_array(&array, &roomy);
        work.copy_array(&roomy, &back);
        work.submit().unwrap();
        assert_eq!(gpu.read_array::<[u32; 2]>(&roomy).unwrap(), content);
        let more = len + 9_000;
        assert!(gpu.resize(&mut back, "back", more as usize).unwrap());
        gpu.write_items(&back, more - 1, &[[1u32, 2]]).unwrap();
        gpu.scatter_items(&back, &[len], &[[3u32, 4]]).unwrap();
        let found: Vec<[u32; 2]> = gpu.read_array(&back).unwrap();
        assert_eq!(found[..len as usize], content);
        let zeros = &found[len as usize + 1..more as usize - 1];
        assert!(zeros.iter().all(|item| *item == [0, 0]));
        assert_eq!(
            [found[len as usize], found[more as usize - 1]],
            [[3, 4], [1, 2]]
        );
    }
}

#[test]
fn large_arrays_round_trip_in_chunks() {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter =
        pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))
            .unwrap();
    // Avoids a very large test array.
    let descriptor = wgpu::DeviceDescriptor {
        required_limits: wgpu::Limits {
            max_buffer_size: 5 << 20,
            max_storage_buffer_binding_size: 5 << 20,
            ..Default::default()
        },
        ..Default::default()
    };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).unwrap();
    let gpu = Gpu::from_wgpu(&adapter, device, queue);
    // More than the 32 MiB of a chunk, from the middle of a row to the middle of another.
    let len = 2_500_000;
    let array = gpu.array("a", Texel::U32x4, len).unwrap();
    let part: Vec<[u32; 4]> = (100..len as u32 - 33).map(|i| [i, 1, 2, !i]).collect();
    gpu.write_items(&array, 100, &part).unwrap();
    let read = gpu.readbacks();
    let found: Vec<[u32; 4]> = gpu.read_array(&array).unwrap();
    assert_eq!(gpu.readbacks(), read + 1);
    assert!(found[100..len - 33] == part);
    let rest = found[..100].iter().chain(&found[len - 33..]);
    assert!(found.len() == len && rest.into_iter().all(|item| *item == [0; 4]));
    let mut pending = gpu.read_array_async::<[u32; 4]>(&array).unwrap();
    let arrived = (0..120_000).find_map(|_| {
        std::thread::sleep(std::time::Duration::from_millis(1));
        pending.try_take().unwrap()
    });
    assert!(arrived.unwrap() == found);
}

#[test]
fn scatter_items_writes_given_indices() {
    let gpu = Gpu::new().unwrap();
    let places = [3u32, 0, 8_999, 8_192];
    let start: Vec<[u32; 4]> = (0..9_000).map(|i| [i; 4]).collect();
    let array = gpu.array_of("a", Texel::U32x4, &start).unwrap();
    let items = places.map(|p| [p + 1, 2, 3, u32::MAX]);
    gpu.scatter_items(&array, &places, &items).unwrap();
    let mut expected = start.clone();
    for (p, item) in places.iter().zip(items) {
        expected[*p as usize] = item;
    }
    assert_eq!(gpu.read_array::<[u32; 4]>(&array).unwrap(), expected);
    let pairs = gpu.array("b", Texel::U32x2, 9_000).unwrap();
    gpu.scatter_items(&pairs, &places, &places.map(|p| [p, 9]))
        .unwrap();
    assert_eq!(
        gpu.read_array::<[u32; 2]>(&pairs).unwrap()[8_999],
        [8_999, 9]
    );
    let pairs = gpu.array("c", Texel::F32x2, 9_000).unwrap();
    gpu.scatter_items(&pairs, &places, &places.map(|p| [p as f32, 0.5]))
        .unwrap();
    assert_eq!(
        gpu.read_array::<[f32; 2]>(&pairs).unwrap()[8_192],
        [8_192.0, 0.5]
    );
    assert!(gpu.scatter_items(&array, &[9_000], &[[0u32; 4]]).is_err());
    assert!(gpu.scatter_items(&array, &places, &[[0u32; 4]]).is_err());
    let vectors = gpu.array("d", Texel::F32x4, 8).unwrap();
    assert!(gpu.scatter_items(&vectors, &[0], &[[0.0f32; 4]]).is_err());
}

#[test]
fn destroyed_device_reports_loss_in_every_call() {
    let lost = |what: &str, result: palpate::Result<()>| {
        assert!(
            matches!(&result, Err(Error::DeviceLost(_))),
            "{what}: {result:?}"
        );
    };
    let gpu = Gpu::new().unwrap();
    let a = gpu.array_of("a", Texel::F32x4, &[[1.0f32; 4]; 3]).unwrap();
    let b = gpu.array("b", Texel::F32x4, 3).unwrap();
    let p = Scale {
        items: 3,
        factor: 5.0,
    };
    let build_pass = || {
        gpu.pass("gpu/scale")
            .read(&a)
            .write(&b)
            .params(&p)
            .dispatch_items(3)
    };
    let pass = build_pass().unwrap();
    gpu.wait().unwrap();
    // Dropping another device does not lose this one.
    drop(Gpu::new().unwrap());
    gpu.poll_errors().unwrap();
    gpu.device().destroy();
    lost("check", gpu.poll_errors());
    lost("wait", gpu.wait());
    lost("array", gpu.array("c", Texel::F32, 3).map(|_| ()));
    lost("buffer", gpu.buffer("c", 8).map(|_| ()));
    let usage = wgpu::TextureUsages::TEXTURE_BINDING;
    let format = wgpu::TextureFormat::Rgba8Unorm;
    lost(
        "texture",
        gpu.target("c", [8, 8], format, usage).map(|_| ()),
    );
    lost("pass", build_pass().map(|_| ()));
    lost("read", gpu.read_array::<[f32; 4]>(&b).map(|_| ()));
    let mut work = gpu.start_recording();
    lost("params", pass.set_params(&mut work, &p));
    pass.record(&mut work);
    lost("submit", work.submit());
    lost("clone", gpu.clone().poll_errors());
}

#[test]
fn parameters_are_bound_to_their_recording() {
    let gpu = Gpu::new().unwrap();
    let a = gpu.array_of("a", Texel::F32x4, &[[1.0f32; 4]; 3]).unwrap();
    let b: Vec<_> = (0..3)
        .map(|_| gpu.array("b", Texel::F32x4, 3).unwrap())
        .collect();
    let scale = |factor| Scale { items: 3, factor };
    let pass = gpu
        .pass("gpu/scale")
        .read(&a)
        .write(&b[0])
        .params(&scale(1.0))
        .dispatch_items(3)
        .unwrap();
    let mut work = gpu.start_recording();
    for (i, factor) in [2.0, 3.0, 2.0].into_iter().enumerate() {
        pass.set_params(&mut work, &scale(factor)).unwrap();
        pass.record(&mut work);
        if i > 0 {
            work.copy_array(&b[0], &b[i]);
        }
    }
    // Another recording, submitted before.
    let mut other = gpu.start_recording();
    pass.set_params(&mut other, &scale(9.0)).unwrap();
    pass.record(&mut other);
    other.submit().unwrap();
    assert_eq!(gpu.read_array::<[f32; 4]>(&b[0]).unwrap(), [[9.0; 4]; 3]);
    work.submit().unwrap();
    assert_eq!(gpu.read_array::<[f32; 4]>(&b[1]).unwrap(), [[3.0; 4]; 3]);
    assert_eq!(gpu.read_array::<[f32; 4]>(&b[2]).unwrap(), [[2.0; 4]; 3]);
    mod wide {
        palpate::gpu_struct! { pub struct Scale { pub items: u32, pub factor: f32, pub more: [u32; 2] } }
    }
    let wide = wide::Scale {
        items: 3,
        factor: 1.0,
        more: [0; 2],
    };
    let error = pass
        .set_params(&mut gpu.start_recording(), &wide)
        .unwrap_err();
    assert!(error.to_string().contains("16 bytes"), "{error}");
}
