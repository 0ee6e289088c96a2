// SPDX-License-Identifier: Apache-2.0
// Sets up the footprints of kernels close to the eye (splat/close_place.h, splat/close.h).

#if STREAKS
bool may_be_close(vec3 u, vec3 k[3], float radius, float h2) {
    return false;
}
#else
const float CLOSE_EXACT = 18.0, CLOSE_AFFINE = 36.0, CLOSE_TRAINED = 3.0, CLOSE_LEAST = 1e-3, EVERYWHERE = 1e30;

struct Kernel {
    vec3 u, su;   // centre; adj Σ · u
    mat3 v, adj;  // Σ, and its adjugate
    float det;    // of Σ
    float square; // ρ²
    float size;   // trace of Σ without the filter
    float own;    // without the filter: ρ²·det Σ
};

// True if a kernel may be close and reach into the image. radius: of the largest footprint (sp_close_select() of splat/close_place.h).
bool may_be_close(vec3 u, vec3 k[3], float radius, float h2) {
    float size = dot(k[0], k[0]) + dot(k[1], k[1]) + dot(k[2], k[2]), depth = max(u.z, 0.0), r2 = 1.01 * radius * radius;
    vec2 beside = max(abs(u.xy) - view.yz / view.x * u.z, 0.0);
    vec2 reach2 = r2 * ((1.0 + bounds.xy * bounds.xy) * size + h2 / (view.x * view.x) * u.z * u.z);
    float before = max(view.w - u.z, 0.0);
    return is_perspective && depth * depth < CLOSE_AFFINE * CLOSE_AFFINE / 3.0 * size && before * before <= r2 * size &&
           all(lessThanEqual(beside * beside, reach2));
}

// The adjugate and the determinant are sums of positive terms, so that flat kernels keep their digits.
Kernel make_kernel(vec3 u, vec3 k[3], float h2) {
    mat3 c = mat3(cross(k[1], k[2]), cross(k[2], k[0]), cross(k[0], k[1])), rows = mat3(k[0], k[1], k[2]);
    mat3 own = transpose(rows) * rows, faces = transpose(c) * c;
    float size = own[0][0] + own[1][1] + own[2][2], thick = 1e-6 * size, volume = dot(k[0], c[0]);
    Kernel to;
    to.u = u;
    to.size = size;
    to.v = own + mat3(thick);
    to.adj = faces + mat3(thick * (size + thick)) - thick * own;
    to.det = volume * volume + thick * (faces[0][0] + faces[1][1] + faces[2][2] + thick * (size + thick));
    to.own = dot(u, to.adj * u);
    float f2 = h2 * u.z * u.z / (view.x * view.x);
    mat3 v = to.v;
    to.det += f2 * (to.adj[0][0] + to.adj[1][1] + f2 * v[2][2]);
    to.adj += f2 * mat3(v[2][2], 0.0, -v[2][0], 0.0, v[2][2], -v[2][1], -v[2][0], -v[2][1], v[0][0] + v[1][1] + f2);
    to.v[0][0] += f2;
    to.v[1][1] += f2;
    to.su = to.adj * u;
    to.square = dot(u, to.su) / to.det;
    return to;
}

float close_share(Kernel k, bool is_integral) {
    float depth = max(k.u.z, 0.0), away = depth * sqrt(3.0 / k.size);
    if (!is_integral)
        away = CLOSE_TRAINED * max(away, depth * inversesqrt(k.v[2][2]));
    float w = clamp((CLOSE_AFFINE - away) / (CLOSE_AFFINE - CLOSE_EXACT), 0.0, 1.0);
    return w * w * (3.0 - 2.0 * w);
}

// Which X = u_i/u2 see the ellipsoid of radius r, from `at` on.
vec2 close_range(Kernel k, int i, float r, float at) {
    float u0 = k.u[i], u2 = k.u.z, v0 = k.v[i][i], v2 = k.v[2][2], v = k.v[i][2], r2 = r * r, last = r2 * v2 - u2 * u2;
    float root = r2 * (v0 * u2 * u2 - 2.0 * v * u0 * u2 + v2 * u0 * u0 - r2 * (v0 * v2 - v * v)), wide = sqrt(max(root, 0.0));
    if (last < 0.0)
        return vec2(r2 * (v * u2 - v2 * u0) / (u2 * last)) + vec2(wide, -wide) / last + (u0 / u2 - at);
    if (!(root > 0.0 && last > 0.0))
        return vec2(-EVERYWHERE, EVERYWHERE);
    float low = (r2 * v - u0 * u2 - wide) / last, high = (r2 * v - u0 * u2 + wide) / last;
    float ahead = (u0 + r * v * inversesqrt(v2)) / (u2 + r * sqrt(v2));
    return vec2(ahead >= high ? high : -EVERYWHERE, ahead <= low ? low : EVERYWHERE) - at;
}

// False if the ellipsoid of radius r is outside the image. The view axis goes through the middle of the image.
bool is_in_image(Kernel k, float r) {
    if (k.u.z + r * sqrt(k.v[2][2]) < view.w)
        return false;
    for (int side = 0; side < 4; side++) {
        int i = side / 2;
        float slope = (side % 2 == 0 ? -1.0 : 1.0) * view[1 + i] / view.x, inside = (side % 2 == 0 ? 1.0 : -1.0) * (k.u[i] - slope * k.u.z);
        float variance = k.v[i][i] - 2.0 * slope * k.v[i][2] + slope * slope * k.v[2][2];
        if (inside < 0.0 && inside * inside > r * r * variance)
            return false;
    }
    return true;
}

vec4 close_box(vec2 x, vec2 y) {
    return vec4(ceil(vec2(x.x, y.x) - 0.5), floor(vec2(x.y, y.y) + 0.5));
}

// The box of a kernel aside that is not all exact: √p ≤ R·(1 + w·more·δ).
vec4 aside_box(Kernel k, float r, float w, vec2 more, Splat s, vec2 centre) {
    float a = s.place.z, b = 0.5 * s.place.w, c = s.shape.x, det = a * c - b * b;
    vec2 own = vec2(c, a) / det, slope = own * w * more - b / det * w * more.yx;
    float r2 = 0.5 * LOG2E * r * r / (1.0 - r * r * w * w / k.square), left = 1.0 - r2 * w * dot(slope, more);
    if (left <= 0.0)
        return close_box(vec2(-EVERYWHERE, EVERYWHERE), vec2(-EVERYWHERE, EVERYWHERE));
    vec2 middle = r2 / left * slope, wide = sqrt(r2 / left * own + middle * middle);
    middle += centre;
    return close_box(middle.x + vec2(-wide.x, wide.x), middle.y + vec2(-wide.y, wide.y));
}

void place_ahead(Kernel k, vec3 rows[3], float h2, float r, float w, inout Splat s, inout vec4 box, inout float gain) {
    vec2 at = k.u.xy / k.u.z, scale = vec2(view.x / w), centre = view.yz + view.x * at, more = k.u.z / (view.x * k.square * k.det) * k.su.xy;
    bool is_aside = any(greaterThan(abs(at), bounds.xy));
    if (is_aside) { // with less of a limit of the Jacobian
        Footprint f = compute_footprint_at(k.u, rows, h2, mix(clamp(at, -bounds.xy, bounds.xy), at, w));
        set_ellipse(f, r, s);
        gain = f.gain * filter_of.w / sqrt(f.det);
    }
    if (is_aside && w < 1.0)
        box = aside_box(k, r, w, more, s, centre);
    else
        box = close_box(centre.x + scale.x * close_range(k, 0, w * r, at.x), centre.y + scale.y * close_range(k, 1, w * r, at.y));
    s.shape.z = w;
    close_words = vec4(more, 0.0, k.square);
}

void place_around(Kernel k, float r, inout Splat s, out vec4 box, out float gain) {
    float first = k.adj[2][2], root = sqrt(k.det * first);
    vec2 x = vec2(-EVERYWHERE, EVERYWHERE), y = x;
    if (k.square > r * r) {
        x = view.y + view.x * close_range(k, 0, r, 0.0);
        y = view.z + view.x * close_range(k, 1, r, 0.0);
    }
    box = close_box(x, y);
    s.place = vec4(2.0 * k.adj[2][0], 2.0 * k.adj[2][1], k.adj[0][0], 2.0 * k.adj[1][0]) / first;
    s.shape.x = k.adj[1][1] / first;
    s.shape.z = -1.0 - view.w * sqrt(first / k.det);
    close_words = vec4(k.su / root, k.square);
    gain = filter_of.w * inversesqrt(first);
    area = max(box.z - box.x, 0.0) * max(box.w - box.y, 0.0);
}

// Changes the splat of a kernel that may be close, whose footprint has the radius r. rows: of K. False if it is not drawn.
bool place_close(Kernel k, vec3 rows[3], float h2, float r, bool is_integral, inout Splat s, inout vec4 box, inout float gain) {
    float w = close_share(k, is_integral), first = k.u.z - (w < 1.0 ? 0.0 : r * sqrt(k.v[2][2]));
    bool is_ahead = first >= view.w && k.square >= (r + 1.0) * (r + 1.0);
    if (!(w > CLOSE_LEAST) || (!is_ahead && w < 1.0))
        return k.u.z >= view.w;
    if (is_ahead)
        place_ahead(k, rows, h2, r, w, s, box, gain);
    else
        place_around(k, r, s, box, gain);
    return is_ahead || is_in_image(k, r);
}
#endif
