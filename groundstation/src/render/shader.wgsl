// The passes of the map view. Positions reach the lens relative to the eye, so that a float is enough; colours are
// sRGB bytes as they are, mixed and shaded as such; depth is reversed.

struct Globals {
    clip_from_eye: mat4x4f,
    /// Of the world's origin; w: how many metres lines and overlays are lifted towards the eye.
    eye: vec4f,
    /// Where the camera looks; w: 1 if voxels that face away from it are not shown.
    forward: vec4f,
    size_px: vec2f,
    /// Lowest and highest of the colour ramp.
    ramp_m: vec2f,
    /// x: 0 colour of the camera, 1 height, 2 certainty; y: 0 perspective, 1 parallel.
    modes: vec2u,
    near_m: f32,
    parallel_depth_per_metre: f32,
    /// The ground grid: x, y of its middle, radius, spacing.
    grid: vec4f,
    ramp: array<vec4f, 32>,
}

@group(0) @binding(0) var<uniform> globals: Globals;

fn to_clip(from_eye: vec3f) -> vec4f {
    return globals.clip_from_eye * vec4f(from_eye, 1.0);
}

/// The same pixel, as if it were `nearer_m` metres nearer.
fn lift(clip: vec4f, nearer_m: f32) -> vec4f {
    if clip.w <= globals.near_m {
        return clip;
    }
    if globals.modes.y == 1u {
        return vec4f(clip.xy, clip.z + nearer_m * globals.parallel_depth_per_metre, clip.w);
    }
    let depth_m = max(clip.w - min(nearer_m, 0.3 * clip.w), globals.near_m);
    return vec4f(clip.xy, clip.w * globals.near_m / depth_m, clip.w);
}

/// A lamp in the south-east high above and a bright sky: every side of a cube has its own brightness.
fn light(normal: vec3f) -> f32 {
    return 0.74 + 0.30 * dot(normal, vec3f(0.30, -0.42, 0.86));
}

fn ramp_color(t: f32) -> vec3f {
    let x = clamp(t, 0.0, 1.0) * 31.0;
    let i = min(u32(x), 30u);
    return mix(globals.ramp[i].rgb, globals.ramp[i + 1u].rgb, x - f32(i));
}

// Voxels: one quad for every side of an occupied voxel that can be seen.

struct Shaded {
    @builtin(position) clip: vec4f,
    @location(0) color: vec4f,
}

/// Whether the voxel is seen from behind: `Facing::hides` in Rust.
fn is_hidden(facing: u32, is_unseen: bool, center_from_eye: vec3f) -> bool {
    if globals.forward.w == 0.0 {
        return false;
    }
    if facing == 13u {
        return is_unseen;
    }
    let direction = select(normalize(center_from_eye), globals.forward.xyz, globals.modes.y == 1u);
    let normal = vec3f(vec3u(facing % 3u, (facing / 3u) % 3u, facing / 9u)) - 1.0;
    return dot(normalize(normal), direction) > 0.15;
}

@vertex
fn voxel_vertex(
    @location(0) place: vec4u,
    @location(1) color: vec4u,
    @location(2) tile: vec4f,
) -> Shaded {
    let voxel = vec3f(place.xyz & vec3u(127u));
    let from_eye = tile.xyz + (voxel + vec3f(place.xyz >> vec3u(7u))) * tile.w;
    let side = place.w & 7u;
    var normal = vec3f(0.0);
    normal[side >> 1u] = 1.0 - 2.0 * f32(side & 1u);
    let open = f32((place.w >> 3u) & 3u) / 3.0;
    let has_color = (place.w & 32u) != 0u;
    let is_cut = (place.w & 64u) != 0u;
    let is_unseen = (place.w & 128u) != 0u;
    var out: Shaded;
    if is_hidden(color.w & 31u, is_unseen, tile.xyz + (voxel + 0.5) * tile.w) && !is_cut {
        // All corners in one place: no triangle.
        out.clip = vec4f(0.0, 0.0, 0.0, 1.0);
        return out;
    }

    var base = vec3f(color.rgb) / 255.0;
    if globals.modes.x == 2u {
        base = ramp_color(f32(color.w >> 5u) / 7.0);
    } else if globals.modes.x == 1u || !has_color {
        let height_m = from_eye.z + globals.eye.z;
        base = ramp_color((height_m - globals.ramp_m.x) / max(globals.ramp_m.y - globals.ramp_m.x, 1e-3));
    }
    if is_cut {
        base = mix(base, vec3f(0.16, 0.17, 0.20), 0.72);
    }
    out.clip = to_clip(from_eye);
    out.color = vec4f(base * light(normal) * (0.52 + 0.48 * open), 1.0);
    return out;
}

@fragment
fn shaded_fragment(in: Shaded) -> @location(0) vec4f {
    return in.color;
}

@fragment
fn hidden_fragment(in: Shaded) -> @location(0) vec4f {
    return vec4f(in.color.rgb, 0.3);
}

// Markers and overlays: plain triangles, lit where they have a normal.

struct Plain {
    @location(0) position: vec3f,
    @location(1) normal: vec4f,
    @location(2) color: vec4f,
}

fn plain(in: Plain, lift_m: f32) -> Shaded {
    var out: Shaded;
    out.clip = lift(to_clip(in.position - globals.eye.xyz), lift_m);
    let lit = select(1.0, light(in.normal.xyz), in.normal.w > 0.5);
    out.color = vec4f(in.color.rgb * lit, in.color.a);
    return out;
}

@vertex
fn solid_vertex(in: Plain) -> Shaded {
    return plain(in, 0.0);
}

@vertex
fn glass_vertex(in: Plain) -> Shaded {
    return plain(in, globals.eye.w);
}

// Lines: a capsule on the screen about each segment, with a dark rim that sets it off from whatever is behind.

const CASING_PX = 1.3;

struct Segment {
    @location(0) start: vec3f,
    @location(1) end: vec3f,
    /// Metres along the whole line at both ends; length of a dash, 0 for none; width in pixels.
    @location(2) along: vec4f,
    @location(3) color: vec4f,
}

struct Stroke {
    @builtin(position) clip: vec4f,
    @location(0) color: vec4f,
    /// Pixels along the segment and across it, length of the segment and half its width.
    @location(1) @interpolate(linear) capsule: vec4f,
    @location(2) dash: vec2f,
}

@vertex
fn line_vertex(@builtin(vertex_index) vertex: u32, in: Segment) -> Stroke {
    var a = to_clip(in.start - globals.eye.xyz);
    var b = to_clip(in.end - globals.eye.xyz);
    var along = in.along.xy;
    // What is behind the lens has no pixel: cut the segment where it comes into view.
    let w = globals.near_m;
    let share = (w - a.w) / (b.w - a.w);
    if a.w < w && b.w >= w {
        a = mix(a, b, share);
        along.x = mix(along.x, along.y, share);
    } else if b.w < w && a.w >= w {
        b = mix(a, b, share);
        along.y = mix(along.x, along.y, share);
    }
    var out: Stroke;
    if a.w < 0.999 * w && b.w < 0.999 * w {
        out.clip = vec4f(0.0, 0.0, -1.0, 1.0);
        return out;
    }
    let a_px = 0.5 * a.xy / a.w * globals.size_px;
    let b_px = 0.5 * b.xy / b.w * globals.size_px;
    let length_px = length(b_px - a_px);
    let forward = select(vec2f(1.0, 0.0), (b_px - a_px) / length_px, length_px > 1e-4);
    let aside = vec2f(-forward.y, forward.x);
    let half_px = 0.5 * in.along.w;
    let reach_px = half_px + CASING_PX + 1.0;

    let at_end = (vertex & 1u) == 1u;
    let side = select(-1.0, 1.0, vertex == 2u || vertex == 3u || vertex == 5u);
    let corner = select(a, b, at_end);
    let offset_px = forward * select(-reach_px, reach_px, at_end) + aside * side * reach_px;
    let moved = vec4f(corner.xy + 2.0 * offset_px / globals.size_px * corner.w, corner.zw);
    out.clip = lift(moved, globals.eye.w);
    out.color = in.color;
    out.capsule = vec4f(select(-reach_px, length_px + reach_px, at_end), side * reach_px, length_px, half_px);
    out.dash = vec2f(select(along.x, along.y, at_end), in.along.z);
    return out;
}

/// How much of the pixel belongs to the line made wider by `rim_px`.
fn cover(in: Stroke, rim_px: f32) -> f32 {
    if in.dash.y > 0.0 && fract(0.5 * in.dash.x / in.dash.y) > 0.5 {
        return 0.0;
    }
    let beyond_px = in.capsule.x - clamp(in.capsule.x, 0.0, in.capsule.z);
    return clamp(in.capsule.w + 0.5 + rim_px - length(vec2f(beyond_px, in.capsule.y)), 0.0, 1.0);
}

@fragment
fn line_fragment(in: Stroke) -> @location(0) vec4f {
    return vec4f(in.color.rgb, in.color.a * cover(in, 0.0));
}

/// Before all lines, so that the rim of a segment does not cross the one before it.
@fragment
fn casing_fragment(in: Stroke) -> @location(0) vec4f {
    return vec4f(vec3f(0.05, 0.06, 0.08), 0.5 * in.color.a * cover(in, CASING_PX));
}

/// What of a line is behind something else is still there, faintly.
@fragment
fn hidden_line_fragment(in: Stroke) -> @location(0) vec4f {
    return vec4f(in.color.rgb, 0.28 * in.color.a * cover(in, 0.0));
}

// The ground: lines every `spacing` and stronger ones every ten, fading towards the rim.

struct Ground {
    @builtin(position) clip: vec4f,
    @location(0) place: vec2f,
}

@vertex
fn ground_vertex(@builtin(vertex_index) vertex: u32) -> Ground {
    let corner = vec2f(f32(vertex & 1u), f32(vertex >> 1u)) * 2.0 - 1.0;
    var out: Ground;
    out.place = globals.grid.xy + corner * globals.grid.z;
    out.clip = to_clip(vec3f(out.place, 0.0) - globals.eye.xyz);
    // Behind the map where they coincide.
    out.clip.z = out.clip.z * 0.999 - 0.01 * globals.parallel_depth_per_metre;
    return out;
}

/// How much of the pixel a line `width_px` wide, repeated every `spacing`, covers.
fn comb(place: vec2f, per_pixel: vec2f, spacing: f32, width_px: f32) -> f32 {
    let from_line = abs(fract(place / spacing - 0.5) - 0.5) * spacing / per_pixel;
    let cover = clamp(vec2f(0.5 * width_px + 0.5) - from_line, vec2f(0.0), vec2f(1.0));
    // Where lines are nearer than a few pixels they would only flicker.
    let calm = clamp(spacing / per_pixel / 4.0 - 1.0, vec2f(0.0), vec2f(1.0));
    return max(cover.x * calm.x, cover.y * calm.y);
}

@fragment
fn ground_fragment(in: Ground) -> @location(0) vec4f {
    let spacing = globals.grid.w;
    let per_pixel = max(fwidth(in.place), vec2f(1e-6));
    let minor = comb(in.place, per_pixel, spacing, 1.0);
    let major = comb(in.place, per_pixel, 10.0 * spacing, 1.4);
    let axis = clamp(vec2f(1.5) - abs(in.place) / per_pixel, vec2f(0.0), vec2f(1.0));
    let rim = 1.0 - smoothstep(0.35, 1.0, length(in.place - globals.grid.xy) / globals.grid.z);
    let alpha = max(max(0.13 * minor, 0.26 * major), 0.55 * max(axis.x, axis.y));
    // East-west and north-south through the origin stand out a little.
    let color = mix(vec3f(0.62, 0.70, 0.80), vec3f(0.80, 0.84, 0.90), max(axis.x, axis.y));
    return vec4f(color, alpha * rim);
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
