// The passes of the 3-D view. Colours are sRGB bytes as they are, mixed as such; depth is reversed: 1 near, 0 far.

struct Globals {
    clip_from_world: mat4x4f,
    eye: vec4f,
    /// Half the picture's width and height at one metre, along its axes.
    right: vec4f,
    up: vec4f,
    forward: vec4f,
    /// What distance fades into; w: share of contrast lost over 100 m.
    air: vec4f,
    size_px: vec2f,
    near_m: f32,
    /// Metres that lines and points are lifted towards the eye.
    lift_m: f32,
}

@group(0) @binding(0) var<uniform> globals: Globals;
@group(0) @binding(1) var atlas: texture_2d<f32>;
@group(0) @binding(2) var sky: texture_2d<f32>;
@group(0) @binding(3) var atlas_sampler: sampler;
@group(0) @binding(4) var sky_sampler: sampler;

fn to_clip(place: vec3f) -> vec4f {
    return globals.clip_from_world * vec4f(place, 1.0);
}

/// The same pixel, as if it were nearer.
fn lifted(clip: vec4f) -> vec4f {
    if clip.w <= globals.near_m {
        return clip;
    }
    let depth_m = max(clip.w - min(globals.lift_m, 0.2 * clip.w), globals.near_m);
    return vec4f(clip.xy, clip.w * globals.near_m / depth_m, clip.w);
}

// The sky, behind everything.

struct Sky {
    @builtin(position) clip: vec4f,
    @location(0) ray: vec3f,
}

@vertex
fn sky_vertex(@builtin(vertex_index) vertex: u32) -> Sky {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u)) * 2.0 - 1.0;
    let ray = globals.forward.xyz + globals.right.xyz * corner.x + globals.up.xyz * corner.y;
    return Sky(vec4f(corner, 0.0, 1.0), ray);
}

@fragment
fn sky_fragment(in: Sky) -> @location(0) vec4f {
    let ray = normalize(in.ray);
    let azimuth = atan2(ray.y, ray.x) / 6.2831853;
    let elevation = asin(clamp(ray.z, -1.0, 1.0)) / 1.5707963;
    let above = textureSampleLevel(sky, sky_sampler, vec2f(azimuth, 1.0 - max(elevation, 0.0)), 0.0).rgb;
    // Beyond the end of the ground there is nothing but air.
    let color = mix(above, globals.air.rgb, smoothstep(0.0, -0.02, elevation));
    return vec4f(color, 1.0);
}

// Surfaces.

struct Corner {
    @location(0) place: vec3f,
    @location(1) uv: vec2f,
    @location(2) color: vec4f,
}

struct Surface {
    @builtin(position) clip: vec4f,
    @location(0) uv: vec2f,
    @location(1) color: vec4f,
    @location(2) place: vec3f,
}

@vertex
fn surface_vertex(in: Corner) -> Surface {
    return Surface(to_clip(in.place), in.uv, in.color, in.place);
}

@fragment
fn surface_fragment(in: Surface) -> @location(0) vec4f {
    let own = textureSample(atlas, atlas_sampler, in.uv) * in.color;
    let distance_m = length(in.place - globals.eye.xyz);
    let clear = 1.0 / (1.0 + globals.air.w * distance_m / 100.0);
    return vec4f(mix(globals.air.rgb, own.rgb, clear), own.a);
}

@fragment
fn glass_fragment(in: Surface) -> @location(0) vec4f {
    return in.color;
}

// Lines: a quad on the screen about each segment.

struct Segment {
    @location(0) start: vec3f,
    @location(1) end: vec3f,
    @location(2) color: vec4f,
    @location(3) width_px: f32,
}

struct Stroke {
    @builtin(position) clip: vec4f,
    @location(0) color: vec4f,
    /// Pixels from the middle of the line, and half its width.
    @location(1) @interpolate(linear) across: vec2f,
}

@vertex
fn line_vertex(@builtin(vertex_index) vertex: u32, in: Segment) -> Stroke {
    var a = to_clip(in.start);
    var b = to_clip(in.end);
    // What is behind the eye has no pixel: cut the segment where it comes into view.
    let w = globals.near_m;
    var out: Stroke;
    if a.w < w && b.w < w {
        out.clip = vec4f(0.0, 0.0, -1.0, 1.0);
        return out;
    }
    let share = (w - a.w) / (b.w - a.w);
    if a.w < w {
        a = mix(a, b, share);
    } else if b.w < w {
        b = mix(a, b, share);
    }
    let a_px = 0.5 * a.xy / a.w * globals.size_px;
    let b_px = 0.5 * b.xy / b.w * globals.size_px;
    let length_px = length(b_px - a_px);
    let forward = select(vec2f(1.0, 0.0), (b_px - a_px) / length_px, length_px > 1e-4);
    let aside = vec2f(-forward.y, forward.x);
    let half_px = 0.5 * in.width_px;
    let reach_px = half_px + 1.0;
    let at_end = (vertex & 1u) == 1u;
    let side = select(-1.0, 1.0, vertex >= 2u);
    let corner = select(a, b, at_end);
    let offset_px = forward * select(-half_px, half_px, at_end) + aside * side * reach_px;
    let moved = vec4f(corner.xy + 2.0 * offset_px / globals.size_px * corner.w, corner.zw);
    out.clip = lifted(moved);
    out.color = in.color;
    out.across = vec2f(side * reach_px, half_px);
    return out;
}

fn cover(across: vec2f) -> f32 {
    return clamp(across.y + 0.5 - abs(across.x), 0.0, 1.0);
}

@fragment
fn line_fragment(in: Stroke) -> @location(0) vec4f {
    return vec4f(in.color.rgb, in.color.a * cover(in.across));
}

/// What of a line is behind something.
@fragment
fn hidden_line_fragment(in: Stroke) -> @location(0) vec4f {
    return vec4f(in.color.rgb, 0.3 * in.color.a * cover(in.across));
}

// Points: a square on the screen about each.

struct Dot {
    @location(0) place: vec3f,
    @location(1) color: vec4f,
}

struct Spot {
    @builtin(position) clip: vec4f,
    @location(0) color: vec4f,
}

@vertex
fn dot_vertex(@builtin(vertex_index) vertex: u32, in: Dot) -> Spot {
    let clip = to_clip(in.place);
    // Larger near by, but never too small to be seen.
    let half_px = clamp(14.0 / max(clip.w, 0.1), 0.8, 2.0);
    let corner = vec2f(f32(vertex & 1u), f32(vertex >> 1u)) * 2.0 - 1.0;
    let moved = vec4f(clip.xy + 2.0 * corner * half_px / globals.size_px * clip.w, clip.zw);
    return Spot(lifted(moved), in.color);
}

@fragment
fn dot_fragment(in: Spot) -> @location(0) vec4f {
    return in.color;
}

// The finished picture, into the window.

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var picture_sampler: sampler;

struct Screen {
    @builtin(position) clip: vec4f,
    @location(0) uv: vec2f,
}

@vertex
fn screen_vertex(@builtin(vertex_index) vertex: u32) -> Screen {
    let uv = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return Screen(vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, 0.0, 1.0), uv);
}

@fragment
fn screen_fragment(in: Screen) -> @location(0) vec4f {
    return vec4f(textureSampleLevel(picture, picture_sampler, in.uv, 0.0).rgb, 1.0);
}

/// For a target that encodes what it is given.
@fragment
fn screen_linear_fragment(in: Screen) -> @location(0) vec4f {
    let gamma = textureSampleLevel(picture, picture_sampler, in.uv, 0.0).rgb;
    let low = gamma / 12.92;
    let high = pow((gamma + 0.055) / 1.055, vec3f(2.4));
    return vec4f(select(high, low, gamma < vec3f(0.04045)), 1.0);
}
