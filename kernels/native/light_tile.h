// The light of a tile's pixels.
//
// A warp lights the corners of its pixels' cells together, each corner once: its threads that need no light at their
// own places take a corner each, and the pixels then blend what was found. Where that would not pay, or where surfaces
// are cut into the faces of meshes, each thread lights the corners of its own facet, one after another. A CPU thread,
// with its one pixel, always does.
#pragma once
#include "shade.h"

namespace warpcam {

constexpr int MOST_CORNERS = 48;  // that a warp lights together, up to two to a thread
constexpr int PANE_COLUMNS = 5, PANE_ROWS = 6;  // of corners in a pane; all fit a warp

// What light_tile() has to know of a pixel.
struct LitPixel {
    Vec place;   // the hit, in the camera's frame [m]
    int shadow;  // bit l: light l does not reach it
    int kept;    // where the look of its shape is kept
};

// The vertex that a pixel lights by itself, step by step: its own place, or the corners of its facet.
template <int TYPES, class Looks, class Meshes>
WARPCAM_FN Vertex own_vertex(const Looks& look, const Meshes& meshes, const Surface& surface, const Facet& facet,
                             Vec place, int step)
{
    if (facet.cut == FINE)
        return { place, look.pose.seen(surface.normal) };
    return vertex_of<TYPES>(look, meshes, surface, facet, step);
}

WARPCAM_FN float own_weight(const Facet& facet, int step)
{
    const float first = 1.0f - facet.weight1 - facet.weight2;
    return step == 0 ? first : step == 1 ? facet.weight1 : facet.weight2;
}

// Corners of one side of a shape, as the same lights reach it, that a warp has lit: rows of PANE_COLUMNS of them.
struct alignas(16) Pane {
    int group, shadow;  // `group`: see number_corners(); -1: there is none
    int column, row;    // the first corner
};

// Shared memory of a warp.
template <int EACH> struct Corkboard {
    Pane pane;
    Row corners[EACH > 0 ? EACH * MOST_CORNERS : 1];
};

#if defined(__CUDA_ARCH__)

WARPCAM_FN int warp_least(int value)
{
#if __CUDA_ARCH__ >= 800
    return __reduce_min_sync(ALL, value);
#else
    for (int step = LANES / 2; step > 0; step /= 2) {
        const int other = __shfl_xor_sync(ALL, value, step);
        value = other < value ? other : value;
    }
    return value;
#endif
}

// a / b of whole numbers from 0 to a few thousand.
WARPCAM_FN int quotient(int a, int b) { return parts_of((to_float(a) + 0.5f) * reciprocal(to_float(b))).whole; }

// A corner of cells that a thread lights for its warp.
struct Task {
    int kept, side, column, row;  // its shape's look; as in Facet
    int shadow;
    int at;  // its place among all corners
};

// Where a pixel's cell begins among the corners, and how far its next row of corners is.
struct Corners {
    int first, stride;
};

// Numbers the corners of the cells that a warp's pixels lie in: of each side of a shape, apart by the lights that reach
// it, all within the bounds of its cells. Finds the corner with the number `wanted`, or else the last one, and
// returns how many there are; more than MOST_CORNERS if they are too many.
template <bool SHADOWS>
WARPCAM_FN int number_corners(const Facet& facet, const LitPixel& pixel, int wanted, Task& task, Corners& corners)
{
    constexpr int MANY = 0x7fffffff;
    const bool asks = facet.cut == CELL;
    const int key = pixel.kept << 3 | facet.side;
    unsigned rest = __ballot_sync(ALL, asks);
    int total = 0;
#pragma unroll 1
    do {
        const int leader = lowest_bit(rest);
        const int group = __shfl_sync(ALL, key, leader), shadow = SHADOWS ? __shfl_sync(ALL, pixel.shadow, leader) : 0;
        const bool mine = asks && key == group && (!SHADOWS || pixel.shadow == shadow);
        rest &= ~__ballot_sync(ALL, mine);
        const int column = warp_least(mine ? facet.column : MANY), row = warp_least(mine ? facet.row : MANY);
        const int stride = -warp_least(mine ? -facet.column : MANY) - column + 2;
        const int rows = -warp_least(mine ? -facet.row : MANY) - row + 2;
        if (stride > MOST_CORNERS || rows > MOST_CORNERS)
            return MOST_CORNERS + 1;
        if (wanted >= total) {
            const int at = lower_int(wanted - total, stride * rows - 1), down = quotient(at, stride);
            task = { group >> 3, group & 7, column + at - down * stride, row + down, shadow, total + at };
        }
        if (mine)
            corners = { total + (facet.row - row) * stride + facet.column - column, stride };
        total += stride * rows;
    } while (rest && total <= MOST_CORNERS);
    return total;
}

// Can a pane hold all that the warp's pixels ask for? Then `pane` stays the one at hand, if that does (`ready`), or
// becomes a new one, which the threads are to light.
template <bool SHADOWS>
WARPCAM_FN bool find_pane(const Facet& facet, const LitPixel& pixel, Pane& pane, bool& ready)
{
    constexpr int MANY = 0x7fffffff;
    const bool asks = facet.cut == CELL;
    const int key = pixel.kept << 3 | facet.side, leader = lowest_bit(__ballot_sync(ALL, asks));
    const int group = __shfl_sync(ALL, key, leader), shadow = SHADOWS ? __shfl_sync(ALL, pixel.shadow, leader) : 0;
    if (any_lane(asks && (key != group || (SHADOWS && pixel.shadow != shadow))))
        return false;
    const int column = warp_least(asks ? facet.column : MANY), row = warp_least(asks ? facet.row : MANY);
    // Corners to spare.
    const int across = PANE_COLUMNS - 2 + warp_least(asks ? -facet.column : MANY) + column;
    const int down = PANE_ROWS - 2 + warp_least(asks ? -facet.row : MANY) + row;
    if (across < 0 || down < 0)
        return false;
    ready = pane.group == group && (!SHADOWS || pane.shadow == shadow) && column >= pane.column && row >= pane.row
        && column <= pane.column + across && row <= pane.row + down;
    if (!ready)
        pane = { group, shadow, column - across / 2, row - down / 2 };
    return true;
}

// Light in shared memory: what is shown of it, LINEAR, DISPLAY or both.
template <bool LINEAR, bool DISPLAY> WARPCAM_FN void put_lit(Row* rows, int at, const Lit& lit)
{
    constexpr int EACH = LINEAR + DISPLAY;
    if (LINEAR)
        rows[EACH * at] = to_row(lit.linear, 0);
    if (DISPLAY)
        rows[EACH * at + LINEAR] = to_row(lit.display, 0);
}

template <bool LINEAR, bool DISPLAY> WARPCAM_FN Lit get_lit(const Row* rows, int at)
{
    constexpr int EACH = LINEAR + DISPLAY;
    Lit lit { { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };
    if (LINEAR)
        lit.linear = to_vec(rows[EACH * at]);
    if (DISPLAY)
        lit.display = to_vec(rows[EACH * at + LINEAR]);
    return lit;
}

// KEPT: `looks` has the looks of all shapes.
template <int TYPES, bool KEPT, bool SHADOWS, bool LINEAR, bool DISPLAY, class Looks, class Meshes>
WARPCAM_FN Lit light_tile(const LightList& list, const Looks* looks, const Looks& look, const Meshes& meshes,
                          const Surface& surface, const Facet& facet, const LitPixel& pixel,
                          Corkboard<LINEAR + DISPLAY>& board, int lane)
{
    constexpr bool CELLS = (TYPES & (1 << PLANE | 1 << BOX)) != 0;
    constexpr bool FACES = (TYPES & (1 << MESH | 1 << HEIGHT_FIELD)) != 0;
    const bool alone = facet.cut == FINE;
    const unsigned others = CELLS || FACES ? ~__ballot_sync(ALL, alone) : 0u;
    bool together = KEPT && CELLS && any_lane(facet.cut == CELL) && !(FACES && any_lane(facet.cut == FACE));
    bool paned = false, ready = false;
    Lit sum { { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };
    Corners corners { 0, 0 };
    Pane pane = board.pane;
    if (KEPT && CELLS && together) {
        paned = others == ALL && find_pane<SHADOWS>(facet, pixel, pane, ready);
        if (!paned)
            pane.group = -1;
        else if (facet.cut == CELL)
            corners = { (facet.row - pane.row) * PANE_COLUMNS + facet.column - pane.column, PANE_COLUMNS };
        __syncwarp();
        board.pane = pane;
    }
#pragma unroll 1
    for (int step = 0; !ready; ++step) {
        Vertex vertex;
        int shadow = pixel.shadow, total = 0, at = 0;
        const Looks* shown = &look;
        bool helps = false;
        if (KEPT && CELLS && together) {
            Task task;
            if (paned) {
                at = lower_int(lane, PANE_COLUMNS * PANE_ROWS - 1);
                const int down = at / PANE_COLUMNS;
                task = { pane.group >> 3, pane.group & 7, pane.column + at - down * PANE_COLUMNS, pane.row + down,
                         pane.shadow, at };
            } else {
                const int helpers = __popc(others), number = __popc(others & ((1u << lane) - 1u)) + step * helpers;
                total = number_corners<SHADOWS>(facet, pixel, number, task, corners);
                together = total <= lower_int(2 * helpers, MOST_CORNERS);
                total -= (step + 1) * helpers;
            }
            helps = together && !alone;
            if (helps) {
                shown = looks + task.kept;
                shadow = task.shadow;
                at = task.at;
                vertex = cell_vertex<TYPES>(*shown, task.side, task.column, task.row);
            }
        }
        if (!helps)
            vertex = own_vertex<TYPES>(look, meshes, surface, facet, pixel.place, step);
        const Lit lit = illuminate<SHADOWS>(list, vertex, shown->finish, shadow);
        if (KEPT && CELLS && together) {
            if (helps)
                put_lit<LINEAR, DISPLAY>(board.corners, at, lit);
            else
                sum = lit;
            if (total <= 0)
                break;
        } else {
            if (!alone)
                add(sum, own_weight(facet, step), lit);
            else if (step == 0)
                sum = lit;
            if (step == 2 || !(CELLS || FACES) || !any_lane(facet.cut == CELL || facet.cut == FACE))
                break;
        }
    }
    if (KEPT && CELLS && together) {
        __syncwarp();
        if (!alone) {
            const int start = corners.first + (facet.start & 1) + (facet.start & 2 ? corners.stride : 0);
            const int second = start + (facet.start & 1 ? -1 : 1);
            const int third = start + (facet.start & 2 ? -corners.stride : corners.stride);
            add(sum, own_weight(facet, 0), get_lit<LINEAR, DISPLAY>(board.corners, start));
            add(sum, facet.weight1, get_lit<LINEAR, DISPLAY>(board.corners, second));
            add(sum, facet.weight2, get_lit<LINEAR, DISPLAY>(board.corners, third));
        }
        __syncwarp();
    }
    return sum;
}

#else

template <int TYPES, bool SHADOWS, class Looks, class Meshes>
WARPCAM_FN Lit light_pixel(const LightList& list, const Looks& look, const Meshes& meshes, const Surface& surface,
                           const Facet& facet, const LitPixel& pixel)
{
    if (facet.cut == FINE)
        return illuminate<SHADOWS>(list, own_vertex<TYPES>(look, meshes, surface, facet, pixel.place, 0), look.finish,
                                   pixel.shadow);
    Lit sum { { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };
    for (int step = 0; step < 3; ++step) {
        const Vertex vertex = own_vertex<TYPES>(look, meshes, surface, facet, pixel.place, step);
        add(sum, own_weight(facet, step), illuminate<SHADOWS>(list, vertex, look.finish, pixel.shadow));
    }
    return sum;
}

#endif

}  // namespace warpcam
