//! How the graphics card is to draw each kind of thing; made once.

use std::mem::size_of;

use sitl::render::diorama::Vertex;
use wgpu::{
    BindGroupLayout, BindingType, BlendState, CompareFunction, Device, Face, PrimitiveTopology,
    RenderPipeline, ShaderModule, TextureFormat, VertexBufferLayout, VertexStepMode,
    vertex_attr_array,
};

/// Of our own picture: colours are the bytes that are shown.
pub(super) const COLOR: TextureFormat = TextureFormat::Rgba8Unorm;
pub(super) const DEPTH: TextureFormat = TextureFormat::Depth32Float;

/// A straight line, so many pixels wide.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Segment {
    pub(crate) start: [f32; 3],
    pub(crate) end: [f32; 3],
    pub(crate) color: [u8; 4],
    pub(crate) width_px: f32,
}

/// A point.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Dot {
    pub(crate) place: [f32; 3],
    pub(crate) color: [u8; 4],
}

/// All pipelines and what they share.
pub(super) struct Pipelines {
    pub(super) sky: RenderPipeline,
    pub(super) surfaces: RenderPipeline,
    pub(super) glass: RenderPipeline,
    pub(super) hidden_lines: RenderPipeline,
    pub(super) lines: RenderPipeline,
    pub(super) dots: RenderPipeline,
    pub(super) screen: RenderPipeline,
    pub(super) scene_layout: BindGroupLayout,
    pub(super) screen_layout: BindGroupLayout,
}

/// In what one kind of thing differs from the others.
struct Kind<'a> {
    name: &'a str,
    stages: [&'a str; 2],
    buffers: &'a [Option<VertexBufferLayout<'a>>],
    topology: PrimitiveTopology,
    cull: Option<Face>,
    /// Nearer is greater.
    compare: CompareFunction,
    writes_depth: bool,
    blends: bool,
}

const CORNER: [wgpu::VertexAttribute; 3] =
    vertex_attr_array![0 => Float32x3, 1 => Float32x2, 2 => Unorm8x4];
const SEGMENT: [wgpu::VertexAttribute; 4] =
    vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Unorm8x4, 3 => Float32];
const DOT: [wgpu::VertexAttribute; 2] = vertex_attr_array![0 => Float32x3, 1 => Unorm8x4];

const fn layout(
    stride: usize,
    step_mode: VertexStepMode,
    attributes: &'static [wgpu::VertexAttribute],
) -> [Option<VertexBufferLayout<'static>>; 1] {
    [Some(VertexBufferLayout {
        array_stride: stride as u64,
        step_mode,
        attributes,
    })]
}

const CORNERS: [Option<VertexBufferLayout<'static>>; 1] =
    layout(size_of::<Vertex>(), VertexStepMode::Vertex, &CORNER);
const SEGMENTS: [Option<VertexBufferLayout<'static>>; 1] =
    layout(size_of::<Segment>(), VertexStepMode::Instance, &SEGMENT);
const DOTS: [Option<VertexBufferLayout<'static>>; 1] =
    layout(size_of::<Dot>(), VertexStepMode::Instance, &DOT);

impl Pipelines {
    /// For pictures of `samples` a pixel that end up in a target of format `target`.
    pub(super) fn new(device: &Device, target: TextureFormat, samples: u32) -> Self {
        let shader = device.create_shader_module(wgpu::include_wgsl!("shader.wgsl"));
        let scene_layout = scene_layout(device);
        let screen_layout = screen_layout(device);
        let [sky, surfaces, glass, hidden_lines, lines, dots] =
            kinds().map(|kind| pipeline(device, &shader, (&scene_layout, samples), &kind));
        Self {
            sky,
            surfaces,
            glass,
            hidden_lines,
            lines,
            dots,
            screen: screen_pipeline(device, &shader, &screen_layout, target),
            scene_layout,
            screen_layout,
        }
    }
}

fn kinds() -> [Kind<'static>; 6] {
    let surfaces = Kind {
        name: "surfaces",
        stages: ["surface_vertex", "surface_fragment"],
        buffers: &CORNERS,
        topology: PrimitiveTopology::TriangleList,
        cull: Some(Face::Back),
        compare: CompareFunction::Greater,
        writes_depth: true,
        blends: false,
    };
    let lines = Kind {
        name: "lines",
        stages: ["line_vertex", "line_fragment"],
        buffers: &SEGMENTS,
        topology: PrimitiveTopology::TriangleStrip,
        cull: None,
        compare: CompareFunction::GreaterEqual,
        writes_depth: false,
        blends: true,
    };
    [
        Kind {
            name: "sky",
            stages: ["sky_vertex", "sky_fragment"],
            buffers: &[],
            cull: None,
            compare: CompareFunction::Always,
            writes_depth: false,
            ..surfaces
        },
        Kind { ..surfaces },
        Kind {
            name: "glass",
            stages: ["surface_vertex", "glass_fragment"],
            cull: None,
            writes_depth: false,
            blends: true,
            ..surfaces
        },
        Kind {
            name: "hidden lines",
            stages: ["line_vertex", "hidden_line_fragment"],
            compare: CompareFunction::Less,
            ..lines
        },
        Kind { ..lines },
        Kind {
            name: "points",
            stages: ["dot_vertex", "dot_fragment"],
            buffers: &DOTS,
            writes_depth: true,
            blends: false,
            ..lines
        },
    ]
}

fn texture_entry(binding: u32) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty: BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: true },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        },
        count: None,
    }
}

fn sampler_entry(binding: u32) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty: BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
        count: None,
    }
}

fn scene_layout(device: &Device) -> BindGroupLayout {
    let globals = wgpu::BindGroupLayoutEntry {
        binding: 0,
        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
        ty: BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("scene"),
        entries: &[
            globals,
            texture_entry(1),
            texture_entry(2),
            sampler_entry(3),
            sampler_entry(4),
        ],
    })
}

fn screen_layout(device: &Device) -> BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("screen"),
        entries: &[texture_entry(0), sampler_entry(1)],
    })
}

fn pipeline(
    device: &Device,
    shader: &ShaderModule,
    (scene, samples): (&BindGroupLayout, u32),
    kind: &Kind<'_>,
) -> RenderPipeline {
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(kind.name),
        bind_group_layouts: &[Some(scene)],
        immediate_size: 0,
    });
    let [vertex, fragment] = kind.stages;
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(kind.name),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: shader,
            entry_point: Some(vertex),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: kind.buffers,
        },
        primitive: wgpu::PrimitiveState {
            topology: kind.topology,
            cull_mode: kind.cull,
            ..wgpu::PrimitiveState::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(kind.writes_depth),
            depth_compare: Some(kind.compare),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState {
            count: samples,
            ..wgpu::MultisampleState::default()
        },
        fragment: Some(wgpu::FragmentState {
            module: shader,
            entry_point: Some(fragment),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format: COLOR,
                blend: kind.blends.then_some(BlendState::ALPHA_BLENDING),
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

fn screen_pipeline(
    device: &Device,
    shader: &ShaderModule,
    screen: &BindGroupLayout,
    target: TextureFormat,
) -> RenderPipeline {
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("screen"),
        bind_group_layouts: &[Some(screen)],
        immediate_size: 0,
    });
    let fragment = if target.is_srgb() {
        "screen_linear_fragment"
    } else {
        "screen_fragment"
    };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("screen"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: shader,
            entry_point: Some("screen_vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: shader,
            entry_point: Some(fragment),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(target.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
