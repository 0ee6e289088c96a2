/* SPDX-License-Identifier: Apache-2.0 */
#include "support/mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

bool test_mesh_init(struct sp_elements *mesh, uint32_t vertices, uint32_t triangles) {
    *mesh = (struct sp_elements){
        .shape = { .kind = SP_KIND_MESH, .count = triangles, .vertex_count = vertices },
        .positions = calloc(vertices + 1, sizeof *mesh->positions),
        .normals = calloc(vertices + 1, sizeof *mesh->normals),
        .colors = calloc(vertices + 1, sizeof *mesh->colors),
        .triangles = calloc(triangles + 1, sizeof *mesh->triangles)
    };
    if (!mesh->positions || !mesh->normals || !mesh->colors || !mesh->triangles) {
        test_mesh_finish(mesh);
        return false;
    }
    for (uint32_t i = 0; i < vertices; i++)
        for (int c = 0; c < 4; c++)
            mesh->colors[i][c] = 1;
    return true;
}

void test_mesh_finish(struct sp_elements *mesh) {
    free(mesh->positions);
    free(mesh->normals);
    free(mesh->colors);
    free(mesh->triangles);
    *mesh = (struct sp_elements){ .shape = { .kind = SP_KIND_MESH } };
}

static void set_quad(struct sp_elements *mesh, uint32_t number, const uint32_t corners[4]) {
    for (int k = 0; k < 3; k++) {
        mesh->triangles[2 * number][k] = corners[k];
        mesh->triangles[2 * number + 1][k] = corners[k ? k + 1 : 0];
    }
}

static void set_vertex(struct sp_elements *mesh, uint32_t i, const double position[3],
                       const double normal[3]) {
    for (int a = 0; a < 3; a++) {
        mesh->positions[i][a] = (float)position[a];
        mesh->normals[i][a] = (float)normal[a];
    }
}

bool test_mesh_ball(struct sp_elements *mesh, uint32_t rings, double radius) {
    const uint32_t around = 2 * rings;
    if (!test_mesh_init(mesh, around * (rings + 1), 2 * around * rings))
        return false;
    for (uint32_t j = 0; j <= rings; j++)
        for (uint32_t i = 0; i < around; i++) {
            const double u = 2 * M_PI * i / around, v = M_PI * j / rings;
            const double n[3] = { cos(u) * sin(v), sin(u) * sin(v), cos(v) };
            const double p[3] = { radius * n[0], radius * n[1], radius * n[2] };
            const uint32_t next = (i + 1) % around, row = j * around;
            set_vertex(mesh, row + i, p, n);
            if (j < rings)
                set_quad(
                    mesh, row + i,
                    (uint32_t[]){ row + i, row + next, row + around + next, row + around + i });
        }
    return true;
}

bool test_mesh_torus(struct sp_elements *mesh, uint32_t n, double circle, double tube) {
    if (!test_mesh_init(mesh, n * n, 2 * n * n))
        return false;
    for (uint32_t j = 0; j < n; j++)
        for (uint32_t i = 0; i < n; i++) {
            const double u = 2 * M_PI * i / n, v = 2 * M_PI * j / n;
            const double normal[3] = { cos(u) * cos(v), sin(u) * cos(v), sin(v) };
            const double p[3] = { circle * cos(u) + tube * normal[0],
                                  circle * sin(u) + tube * normal[1], tube * normal[2] };
            const uint32_t next = (i + 1) % n, row = j * n, below = (j + 1) % n * n;
            set_vertex(mesh, row + i, p, normal);
            mesh->colors[row + i][0] = (float)(0.5 + 0.5 * cos(3 * u));
            mesh->colors[row + i][2] = (float)(0.5 + 0.5 * sin(2 * v));
            set_quad(mesh, row + i, (uint32_t[]){ row + i, row + next, below + next, below + i });
        }
    return true;
}

bool test_mesh_cube(struct sp_elements *mesh, double side) {
    if (!test_mesh_init(mesh, 24, 12))
        return false;
    for (uint32_t face = 0; face < 6; face++) {
        const uint32_t a = face / 2, b = (a + 1) % 3, c = (a + 2) % 3;
        for (uint32_t k = 0; k < 4; k++) {
            float *p = mesh->positions[4 * face + k];
            p[a] = (float)(face % 2 ? side / 2 : -side / 2);
            p[b] = (float)(k == 1 || k == 2 ? side / 2 : -side / 2);
            p[c] = (float)(k >= 2 ? side / 2 : -side / 2);
            mesh->colors[4 * face + k][a] = 0.4f;
        }
        set_quad(mesh, face, (uint32_t[]){ 4 * face, 4 * face + 1, 4 * face + 2, 4 * face + 3 });
    }
    return true;
}

/* A triangle in the world of the view. */
struct triangle {
    double p[3][3], n[3][3], color[3][4];
    double box[4]; /* in the image, px: pixels outside need not be tried */
};

struct scene {
    const struct sp_view *view;
    const struct sp_layer *layer;
    struct triangle *triangles;
    uint32_t count, plane_count;
    double planes[6 + SP_CLIP_PLANES_MAX][4]; /* keeps p·n ≥ offset */
    double eye[3], right[3], down[3], ahead[3], scale;
};

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static void normalise(double a[3]) {
    const double length = sqrt(dot(a, a));
    for (int i = 0; i < 3 && length > 0; i++)
        a[i] /= length;
}

static void init_camera(struct scene *s) {
    const struct sp_camera *c = &s->view->camera;
    for (int a = 0; a < 3; a++) {
        s->eye[a] = c->position[a];
        s->ahead[a] = c->target[a] - c->position[a];
    }
    normalise(s->ahead);
    cross(s->ahead, c->up, s->right);
    normalise(s->right);
    cross(s->ahead, s->right, s->down);
    s->scale = c->projection == SP_PERSPECTIVE ? s->view->size[1] / (2 * tan(c->fov_y * M_PI / 360))
                                               : s->view->size[1] / c->height;
}

static void add_plane(struct scene *s, const double normal[3], double offset) {
    double *plane = s->planes[s->plane_count++];
    memcpy(plane, normal, 3 * sizeof *plane);
    plane[3] = offset;
}

/* The grid's axes are at right angles. */
static void init_planes(struct scene *s, const struct sp_grid *grid) {
    const struct sp_clip *clip = &s->view->clip;
    for (int a = 0; a < 3; a++) {
        const double length = grid->spacing[a] * grid->dims[a];
        double n[3], low = -grid->spacing[a] / 2;
        for (int r = 0; r < 3; r++) {
            n[r] = grid->direction[r][a];
            low += n[r] * grid->origin[r];
        }
        if (clip->box[0][a] > 0)
            add_plane(s, n, low + clip->box[0][a] * length);
        for (int r = 0; r < 3; r++)
            n[r] = -n[r];
        if (clip->box[1][a] < 1)
            add_plane(s, n, -(low + clip->box[1][a] * length));
    }
    for (uint32_t i = 0; i < clip->plane_count; i++)
        add_plane(s, clip->planes[i].normal, clip->planes[i].offset);
}

/* Finds the pixels that a triangle may touch. */
static void compute_box(const struct scene *s, struct triangle *t) {
    const bool is_perspective = s->view->camera.projection == SP_PERSPECTIVE;
    t->box[0] = t->box[1] = INFINITY;
    t->box[2] = t->box[3] = -INFINITY;
    for (int k = 0; k < 3; k++) {
        double from_eye[3], at[2];
        for (int a = 0; a < 3; a++)
            from_eye[a] = t->p[k][a] - s->eye[a];
        const double depth = dot(from_eye, s->ahead);
        if (is_perspective && depth < 1e-3) {
            t->box[0] = t->box[1] = -INFINITY;
            t->box[2] = t->box[3] = INFINITY;
            return;
        }
        at[0] = s->view->size[0] / 2.0 +
                s->scale * dot(from_eye, s->right) / (is_perspective ? depth : 1);
        at[1] = s->view->size[1] / 2.0 +
                s->scale * dot(from_eye, s->down) / (is_perspective ? depth : 1);
        for (int i = 0; i < 2; i++) {
            t->box[i] = fmin(t->box[i], at[i] - 1e-6);
            t->box[2 + i] = fmax(t->box[2 + i], at[i] + 1e-6);
        }
    }
}

/* Normals are turned by the inverse of the transposed transform, times its determinant. */
static void turn_normal(const double m[16], const float from[3], double to[3]) {
    for (int r = 0; r < 3; r++) {
        const int p = (r + 1) % 3, q = (r + 2) % 3;
        to[r] = 0;
        for (int a = 0; a < 3; a++) {
            const int b = (a + 1) % 3, c = (a + 2) % 3;
            to[r] += (double)from[a] * (m[4 * p + b] * m[4 * q + c] - m[4 * q + b] * m[4 * p + c]);
        }
    }
}

static void init_triangles(struct scene *s, const struct sp_elements *mesh) {
    const double *m = s->layer->transform;
    for (uint32_t i = 0; i < mesh->shape.count; i++) {
        struct triangle *t = &s->triangles[s->count];
        bool is_finite = true;
        for (int k = 0; k < 3; k++) {
            const uint32_t vertex = mesh->triangles[i][k];
            const float *p = mesh->positions[vertex];
            for (int r = 0; r < 3; r++) {
                t->p[k][r] = m[4 * r] * (double)p[0] + m[4 * r + 1] * (double)p[1] +
                             m[4 * r + 2] * (double)p[2] + m[4 * r + 3];
                is_finite = is_finite && isfinite(t->p[k][r]);
            }
            turn_normal(m, mesh->normals[vertex], t->n[k]);
            for (int c = 0; c < 4; c++)
                t->color[k][c] =
                    c < 3 && (s->layer->colors == SP_COLORS_OF_LAYER || mesh->shape.lacks_colors)
                        ? (double)s->layer->color[c]
                        : (double)mesh->colors[vertex][c];
        }
        if (!is_finite)
            continue;
        compute_box(s, t);
        s->count++;
    }
}

/* Phong's model with Blinn's half vector, two-sided (renderer/splat/shade.h). */
static void shade(const struct scene *s, double normal[3], const double to_eye[3],
                  double color[3]) {
    const struct sp_shading *shading = &s->view->shading;
    double lit[3], shine[3] = { 0, 0, 0 };
    if (shading->mode != SP_SHADING_PHONG)
        return;
    normalise(normal);
    for (int c = 0; c < 3; c++)
        lit[c] = shading->ambient;
    for (uint32_t i = 0; i < shading->light_count; i++) {
        const struct sp_light *light = &shading->lights[i];
        double l[3], h[3];
        for (int a = 0; a < 3; a++)
            l[a] = light->space == SP_LIGHT_WORLD
                       ? light->direction[a]
                       : light->direction[0] * s->right[a] - light->direction[1] * s->down[a] -
                             light->direction[2] * s->ahead[a];
        normalise(l);
        for (int a = 0; a < 3; a++)
            h[a] = l[a] + to_eye[a];
        normalise(h);
        for (int c = 0; c < 3; c++) {
            lit[c] += shading->diffuse * (double)light->color[c] * fabs(dot(normal, l));
            shine[c] += shading->specular * (double)light->color[c] *
                        pow(fabs(dot(normal, h)), shading->exponent);
        }
    }
    for (int c = 0; c < 3; c++)
        color[c] = color[c] * lit[c] + shine[c];
}

/* Intersects a ray with a triangle (Möller and Trumbore 1997). */
static bool intersect(const struct scene *s, const struct triangle *t, const double start[3],
                      const double ray[3], struct test_hit *hit) {
    double e[2][3], from[3], p[3], q[3], share[3], at[3], normal[3], to_eye[3];
    for (int a = 0; a < 3; a++) {
        e[0][a] = t->p[1][a] - t->p[0][a];
        e[1][a] = t->p[2][a] - t->p[0][a];
        from[a] = start[a] - t->p[0][a];
    }
    cross(ray, e[1], p);
    const double det = dot(e[0], p);
    if (det == 0)
        return false;
    cross(from, e[0], q);
    share[1] = dot(from, p) / det;
    share[2] = dot(ray, q) / det;
    share[0] = 1 - share[1] - share[2];
    if (!(share[0] >= 0 && share[1] >= 0 && share[2] >= 0))
        return false;
    const double way = dot(e[1], q) / det;
    for (int a = 0; a < 3; a++) {
        at[a] = start[a] + way * ray[a];
        to_eye[a] = -ray[a];
        normal[a] = share[0] * t->n[0][a] + share[1] * t->n[1][a] + share[2] * t->n[2][a];
    }
    hit->depth = way * dot(ray, s->ahead);
    if (!(hit->depth >= s->view->camera.near))
        return false;
    for (uint32_t i = 0; i < s->plane_count; i++)
        if (dot(s->planes[i], at) < s->planes[i][3])
            return false;
    if (dot(normal, normal) == 0)
        cross(e[0], e[1], normal);
    for (int c = 0; c < 3; c++)
        hit->color[c] =
            share[0] * t->color[0][c] + share[1] * t->color[1][c] + share[2] * t->color[2][c];
    hit->alpha =
        (double)s->layer->opacity *
        (share[0] * t->color[0][3] + share[1] * t->color[1][3] + share[2] * t->color[2][3]);
    shade(s, normal, to_eye, hit->color);
    return true;
}

struct test_mesh_rays {
    struct scene scene;
    uint32_t *tried, tried_count; /* triangles that the chosen pixel may show */
};

void test_mesh_rays_destroy(struct test_mesh_rays **rays) {
    if (*rays) {
        free((*rays)->scene.triangles);
        free((*rays)->tried);
    }
    free(*rays);
    *rays = NULL;
}

struct test_mesh_rays *test_mesh_rays_create(const struct sp_elements *mesh,
                                             const struct sp_layer *layer,
                                             const struct sp_view *view,
                                             const struct sp_grid *grid) {
    struct test_mesh_rays *rays = calloc(1, sizeof *rays);
    const size_t count = mesh->shape.count + 1;
    if (!rays)
        return NULL;
    rays->scene = (struct scene){ .view = view,
                                  .layer = layer,
                                  .triangles = malloc(count * sizeof *rays->scene.triangles) };
    rays->tried = malloc(count * sizeof *rays->tried);
    if (!rays->scene.triangles || !rays->tried) {
        test_mesh_rays_destroy(&rays);
        return NULL;
    }
    init_camera(&rays->scene);
    init_planes(&rays->scene, grid);
    init_triangles(&rays->scene, mesh);
    return rays;
}

void test_mesh_rays_pixel(struct test_mesh_rays *rays, unsigned x, unsigned y) {
    rays->tried_count = 0;
    for (uint32_t i = 0; i < rays->scene.count; i++) {
        const double *box = rays->scene.triangles[i].box;
        if (box[0] <= x + 1 && box[2] >= x && box[1] <= y + 1 && box[3] >= y)
            rays->tried[rays->tried_count++] = i;
    }
}

int test_mesh_rays_hits(const struct test_mesh_rays *rays, double x, double y,
                        struct test_hit *hits) {
    const struct scene *s = &rays->scene;
    const bool is_perspective = s->view->camera.projection == SP_PERSPECTIVE;
    const double px = (x - s->view->size[0] / 2.0) / s->scale;
    const double py = (y - s->view->size[1] / 2.0) / s->scale;
    double start[3], ray[3];
    int found = 0;
    for (int a = 0; a < 3; a++) {
        const double beside = px * s->right[a] + py * s->down[a];
        start[a] = s->eye[a] + (is_perspective ? 0 : beside);
        ray[a] = s->ahead[a] + (is_perspective ? beside : 0);
    }
    normalise(ray);
    for (uint32_t i = 0; i < rays->tried_count && found < TEST_HITS_MAX; i++) {
        struct test_hit hit;
        int at = found;
        if (!intersect(s, &s->triangles[rays->tried[i]], start, ray, &hit))
            continue;
        for (found++; at > 0 && hit.depth < hits[at - 1].depth; at--)
            hits[at] = hits[at - 1];
        hits[at] = hit;
    }
    return found;
}

/* Adds the colour and the opacity of a ray, times `weight`. */
static void trace(const struct test_mesh_rays *rays, double x, double y, double weight,
                  double rgba[4]) {
    struct test_hit hits[TEST_HITS_MAX];
    const int found = test_mesh_rays_hits(rays, x, y, hits);
    double light = weight;
    for (int i = 0; i < found; i++) {
        for (int c = 0; c < 3; c++)
            rgba[c] += light * hits[i].alpha * hits[i].color[c];
        rgba[3] += light * hits[i].alpha;
        light *= 1 - hits[i].alpha;
    }
}

static void render_pixel(struct test_mesh_rays *rays, unsigned x, unsigned y, int side,
                         double rgba[4]) {
    test_mesh_rays_pixel(rays, x, y);
    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++)
            trace(rays, x + (i + 0.5) / side, y + (j + 0.5) / side, 1.0 / (side * side), rgba);
}

bool test_mesh_render(const struct sp_elements *mesh, const struct sp_layer *layer,
                      const struct sp_view *view, const struct sp_grid *grid, int rays,
                      struct test_image *image) {
    struct test_mesh_rays *all = test_mesh_rays_create(mesh, layer, view, grid);
    const bool ok = all && test_image_init(image, view->size[0], view->size[1]);
    for (unsigned y = 0; ok && y < image->height; y++)
        for (unsigned x = 0; x < image->width; x++)
            render_pixel(all, x, y, rays, test_image_at(image, x, y));
    test_mesh_rays_destroy(&all);
    return ok;
}
