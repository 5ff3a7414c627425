//! How the graphics card is to draw each kind of thing; made once.

use std::mem::size_of;

use wgpu::{
    BindGroupLayout, BlendState, CompareFunction, Device, Face, PrimitiveTopology, RenderPipeline,
    ShaderModule, TextureFormat, VertexBufferLayout, VertexStepMode, vertex_attr_array,
};

use super::mesh::Vertex;
use super::sketch::{PlainVertex, Segment};

/// Of our own picture: colours are the bytes that are shown.
pub(crate) const COLOR: TextureFormat = TextureFormat::Rgba8Unorm;
pub(crate) const DEPTH: TextureFormat = TextureFormat::Depth32Float;
pub(crate) const SAMPLES: u32 = 4;

/// All pipelines and what they share.
pub(crate) struct Pipelines {
    pub(crate) voxels: RenderPipeline,
    /// What of a vehicle is behind something, so that none is ever lost.
    pub(crate) hidden_solid: RenderPipeline,
    pub(crate) solid: RenderPipeline,
    pub(crate) ground: RenderPipeline,
    pub(crate) glass: RenderPipeline,
    pub(crate) lines: RenderPipeline,
    /// What of a line is behind something.
    pub(crate) hidden_lines: RenderPipeline,
    /// Their dark rims.
    pub(crate) casings: RenderPipeline,
    pub(crate) screen: RenderPipeline,
    pub(crate) globals_layout: BindGroupLayout,
    pub(crate) screen_layout: BindGroupLayout,
}

/// In what one kind of thing differs from the others.
struct Kind<'a> {
    name: &'a str,
    vertex: &'a str,
    fragment: &'a str,
    buffers: &'a [Option<VertexBufferLayout<'a>>],
    topology: PrimitiveTopology,
    cull: Option<Face>,
    /// Nearer is greater.
    compare: CompareFunction,
    /// Opaque things write depth, transparent ones blend.
    is_opaque: bool,
}

impl Pipelines {
    /// For pictures that end up in a target of format `target`.
    pub(crate) fn new(device: &Device, target: TextureFormat) -> Self {
        let shader = device.create_shader_module(wgpu::include_wgsl!("shader.wgsl"));
        let globals_layout = globals_layout(device);
        let screen_layout = screen_layout(device);
        let [
            voxels,
            hidden_solid,
            solid,
            ground,
            glass,
            lines,
            hidden_lines,
            casings,
        ] = kinds().map(|kind| pipeline(device, &shader, &globals_layout, &kind));
        Self {
            voxels,
            hidden_solid,
            solid,
            ground,
            glass,
            lines,
            hidden_lines,
            casings,
            screen: screen_pipeline(device, &shader, &screen_layout, target),
            globals_layout,
            screen_layout,
        }
    }
}

const VOXEL_ATTRIBUTES: [wgpu::VertexAttribute; 2] = vertex_attr_array![0 => Uint8x4, 1 => Uint8x4];
const TILE_ATTRIBUTES: [wgpu::VertexAttribute; 1] = vertex_attr_array![2 => Float32x4];
const PLAIN_ATTRIBUTES: [wgpu::VertexAttribute; 3] =
    vertex_attr_array![0 => Float32x3, 1 => Snorm8x4, 2 => Unorm8x4];
const SEGMENT_ATTRIBUTES: [wgpu::VertexAttribute; 4] =
    vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x4, 3 => Unorm8x4];

const VOXEL_BUFFERS: [Option<VertexBufferLayout<'static>>; 2] = [
    Some(layout(
        size_of::<Vertex>(),
        VertexStepMode::Vertex,
        &VOXEL_ATTRIBUTES,
    )),
    Some(layout(
        size_of::<[f32; 4]>(),
        VertexStepMode::Instance,
        &TILE_ATTRIBUTES,
    )),
];
const PLAIN_BUFFERS: [Option<VertexBufferLayout<'static>>; 1] = [Some(layout(
    size_of::<PlainVertex>(),
    VertexStepMode::Vertex,
    &PLAIN_ATTRIBUTES,
))];
const SEGMENT_BUFFERS: [Option<VertexBufferLayout<'static>>; 1] = [Some(layout(
    size_of::<Segment>(),
    VertexStepMode::Instance,
    &SEGMENT_ATTRIBUTES,
))];

const fn layout(
    stride: usize,
    step_mode: VertexStepMode,
    attributes: &'static [wgpu::VertexAttribute],
) -> VertexBufferLayout<'static> {
    VertexBufferLayout {
        array_stride: stride as u64,
        step_mode,
        attributes,
    }
}

fn kinds() -> [Kind<'static>; 8] {
    let solid = Kind {
        name: "solid",
        vertex: "solid_vertex",
        fragment: "shaded_fragment",
        buffers: &PLAIN_BUFFERS,
        topology: PrimitiveTopology::TriangleList,
        cull: None,
        compare: CompareFunction::Greater,
        is_opaque: true,
    };
    let lines = Kind {
        name: "lines",
        vertex: "line_vertex",
        fragment: "line_fragment",
        buffers: &SEGMENT_BUFFERS,
        topology: PrimitiveTopology::TriangleStrip,
        cull: None,
        compare: CompareFunction::GreaterEqual,
        is_opaque: false,
    };
    [
        Kind {
            name: "voxels",
            vertex: "voxel_vertex",
            buffers: &VOXEL_BUFFERS,
            cull: Some(Face::Back),
            ..solid
        },
        Kind {
            name: "hidden solid",
            fragment: "hidden_fragment",
            compare: CompareFunction::Less,
            is_opaque: false,
            ..solid
        },
        Kind { ..solid },
        Kind {
            name: "ground",
            vertex: "ground_vertex",
            fragment: "ground_fragment",
            buffers: &[],
            topology: PrimitiveTopology::TriangleStrip,
            is_opaque: false,
            ..solid
        },
        Kind {
            name: "glass",
            vertex: "glass_vertex",
            is_opaque: false,
            ..solid
        },
        Kind { ..lines },
        Kind {
            name: "hidden lines",
            fragment: "hidden_line_fragment",
            compare: CompareFunction::Less,
            ..lines
        },
        Kind {
            name: "casings",
            fragment: "casing_fragment",
            ..lines
        },
    ]
}

fn globals_layout(device: &Device) -> BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("globals"),
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        }],
    })
}

fn screen_layout(device: &Device) -> BindGroupLayout {
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty,
        count: None,
    };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("screen"),
        entries: &[
            entry(
                0,
                wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Float { filterable: true },
                    view_dimension: wgpu::TextureViewDimension::D2,
                    multisampled: false,
                },
            ),
            entry(
                1,
                wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
            ),
        ],
    })
}

fn pipeline(
    device: &Device,
    shader: &ShaderModule,
    globals: &BindGroupLayout,
    kind: &Kind<'_>,
) -> RenderPipeline {
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(kind.name),
        bind_group_layouts: &[Some(globals)],
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(kind.name),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: shader,
            entry_point: Some(kind.vertex),
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
            depth_write_enabled: Some(kind.is_opaque),
            depth_compare: Some(kind.compare),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState {
            count: SAMPLES,
            ..wgpu::MultisampleState::default()
        },
        fragment: Some(wgpu::FragmentState {
            module: shader,
            entry_point: Some(kind.fragment),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format: COLOR,
                blend: (!kind.is_opaque).then_some(BlendState::ALPHA_BLENDING),
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
