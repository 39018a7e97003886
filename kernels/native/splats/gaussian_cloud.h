// Clouds of Gaussians as one view sees them, and which Gaussians a ray meets, nearest first.
#pragma once
#include "flow/optical_flow.h"

namespace warpcam {

constexpr int MAX_ORDERED_HITS = 32;  // hits that a ray orders at once: more cost shared memory, fewer cost walks

// A hit, ordered by t: bits of t, which is not negative, above those of the Gaussian's name.
using Key = unsigned long long;
constexpr Key NO_KEY = ~0ull;
WARPCAM_DEVICE Key key_of(float t, unsigned name) { return Key(unsigned(as_int(t))) << 32 | name; }
WARPCAM_DEVICE float time_of(Key key) { return as_float(int(key >> 32)); }

// A cloud as one view sees it; rows take camera coordinates to its own, as Record's do.
struct Cloud {
    Float3Int axis_x;  // w: shape, or -1 where nothing is seen
    Float3Int axis_y;  // w: first node
    Float3Int axis_z;  // w: first Gaussian
    Float3Int origin;  // w: bits of the shape's opacity
    float extent, reach;  // see types.py, Splats.clouds

    template <int LENS> WARPCAM_DEVICE Ray local(const CameraRay<LENS>& ray) const
    {
        return ray.local({ axis_x, axis_y, axis_z, origin, {} });
    }
};

template <class Shapes, class Splats> WARPCAM_DEVICE void load_cloud(Cloud& cloud, const Shapes& shapes,
                                                                     const Splats& splats, const Camera& camera,
                                                                     int world, int place)
{
    const int shape = wp::index(splats.columns, place);
    const auto color = per_world(shapes.colors, world, shape);
    const int asset = per_world(shapes.assets, world, shape);
    const Vec3 size = as_vec3(per_world(shapes.sizes, world, shape));
    cloud.axis_x.w = -1;
    if (!(color[3] > 0.0f) || asset < 0 || size.x == 0.0f || size.y == 0.0f || size.z == 0.0f)
        return;
    const auto position = *wp::address(shapes.positions, world, shape);
    const auto rotation = *wp::address(shapes.rotations, world, shape);
    if (rotation.data[0][0] == 0.0f && rotation.data[1][0] == 0.0f && rotation.data[2][0] == 0.0f)
        return;
    const Mat3 r = as_mat3(rotation), m = transposed_times(r, camera.rotation);
    const Vec3 scale { 1.0f / size.x, 1.0f / size.y, 1.0f / size.z };
    const Vec3 o = mul(scale, transform_transposed(r, camera.origin - as_vec3(position)));
    Float3Int* rows[3] = { &cloud.axis_x, &cloud.axis_y, &cloud.axis_z };
    for (int i = 0; i < 3; ++i) {
        const Vec3 v = component(scale, i) * Vec3 { m.at[i][0], m.at[i][1], m.at[i][2] };
        rows[i]->x = v.x;
        rows[i]->y = v.y;
        rows[i]->z = v.z;
    }
    const Float3Int head = load(splats.clouds.data, asset);
    cloud.axis_x.w = shape;
    cloud.axis_y.w = as_int(head.x);
    cloud.axis_z.w = as_int(head.y);
    cloud.origin = { o.x, o.y, o.z, as_int(min(color[3], 1.0f)) };
    cloud.extent = head.z;
    cloud.reach = as_float(head.w);
}

// The ray in the frame in which a Gaussian's ellipsoid is the unit sphere.
struct GaussianSpaceRay {
    Vec3 origin, direction;
};

WARPCAM_DEVICE GaussianSpaceRay whiten(const Float3Int& a, const Float3Int& b, const Float3Int& c, const Ray& ray)
{
    const Vec3 off = ray.origin - Vec3 { as_float(a.w), as_float(b.w), as_float(c.w) };
    return { { dot(as_vec3(a), off), dot(as_vec3(b), off), dot(as_vec3(c), off) },
             { dot(as_vec3(a), ray.direction), dot(as_vec3(b), ray.direction), dot(as_vec3(c), ray.direction) } };
}

// The nearest hits of a ray after `after` and before `end`.
struct Nearest {
    Key* keys;  // ascending, every `step`-th
    int step, count;
    Key after, end;

    WARPCAM_DEVICE Key bound() const { return count < MAX_ORDERED_HITS ? end : keys[(MAX_ORDERED_HITS - 1) * step]; }

    WARPCAM_DEVICE void add(Key key)  // below bound()
    {
        int i = count < MAX_ORDERED_HITS ? count++ : MAX_ORDERED_HITS - 1;
        for (; i > 0 && keys[(i - 1) * step] > key; --i)
            keys[i * step] = keys[(i - 1) * step];
        keys[i * step] = key;
    }
};

WARPCAM_DEVICE void order(Key& a, Key& b)
{
    const Key low = a < b ? a : b;
    b = a < b ? b : a;
    a = low;
}

WARPCAM_DEVICE void test_leaf(const void* gaussians, const Cloud& cloud, const Ray& ray, int code, unsigned name,
                              Nearest& nearest)
{
    const int first = code >> 4, end = first + (code & 15);
    Key bound = nearest.bound();
    for (int i = first; i < end; ++i) {
        const unsigned row = 4u * (unsigned(cloud.axis_z.w) + i);
        const GaussianSpaceRay w =
            whiten(load(gaussians, row), load(gaussians, row + 1), load(gaussians, row + 2), ray);
        const Vec3 off = cross(w.origin, w.direction);
        const float dd = dot(w.direction, w.direction), t = -dot(w.origin, w.direction) * rcp(dd);
        if (dot(off, off) < dd && t > 0.0f) {
            const Key key = key_of(t, name | unsigned(i));
            if (key > nearest.after && key < bound) {
                nearest.add(key);
                bound = nearest.bound();
            }
        }
    }
}

// Gathers the hits of one cloud; `name` are the upper bits of their names.
template <class Splats>
WARPCAM_DEVICE void walk(const Splats& splats, const Cloud& cloud, const Ray& ray, unsigned name, Nearest& nearest)
{
    const Slabs s = slabs(ray.origin, ray.direction, cloud.extent);
    const float from = time_of(nearest.after);
    Key stack[STACK];  // where the ray enters a child's box, and the child
    int top = 0, child = 0;
    for (;;) {
        Key next = NO_KEY;
        if (child >= 0) {
            const unsigned row = 8u * (unsigned(cloud.axis_y.w) + child);
            const float until = time_of(nearest.bound());
            Key found[4];
#pragma unroll
            for (int k = 0; k < 4; ++k) {
                const Float3Int lo = load(splats.nodes.data, row + 2 * k),
                                hi = load(splats.nodes.data, row + 2 * k + 1);
                const float x0 = lo.x * s.scale.x + s.down.x, x1 = hi.x * s.scale.x + s.up.x;
                const float y0 = lo.y * s.scale.y + s.down.y, y1 = hi.y * s.scale.y + s.up.y;
                const float z0 = lo.z * s.scale.z + s.down.z, z1 = hi.z * s.scale.z + s.up.z;
                const float enter = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), from));
                const float t_far = min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), until));
                found[k] = enter <= t_far ? key_of(enter, unsigned(lo.w)) : NO_KEY;
            }
            order(found[0], found[1]);
            order(found[2], found[3]);
            order(found[0], found[2]);
            order(found[1], found[3]);
            order(found[1], found[2]);
#pragma unroll
            for (int k = 3; k > 0; --k)
                if (found[k] != NO_KEY)
                    stack[top++] = found[k];
            next = found[0];
        } else {
            test_leaf(splats.gaussians.data, cloud, ray, -(child + 1), name, nearest);
        }
        const unsigned until = unsigned(nearest.bound() >> 32);
        while (next == NO_KEY && top > 0) {
            next = stack[--top];
            if (unsigned(next >> 32) > until)
                next = NO_KEY;
        }
        if (next == NO_KEY)
            return;
        child = int(unsigned(next));
    }
}

}  // namespace warpcam
