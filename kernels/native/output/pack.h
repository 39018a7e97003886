// Images copied into rows of others' buffers. A thread takes four numbers or pixels beside each other, which are loaded
// and stored at once wherever both images lie so that they can be.
#pragma once
#include "core/platform.h"

namespace warpcam {

constexpr int RUN = 4;

// Run of pixels of a world's row that one thread packs.
struct Run {
    int world, first, count;
};

WARPCAM_DEVICE Run run_of(int index, int row)
{
    const int runs = (row + RUN - 1) / RUN, world = index / runs, first = RUN * (index - world * runs);
    return { world, first, row - first < RUN ? row - first : RUN };
}

template <int BYTES, class Value> WARPCAM_DEVICE bool lies_at(const Value* place) { return size_t(place) % BYTES == 0; }

template <class Value> WARPCAM_DEVICE void load_run(const Value* from, int count, Value (&values)[RUN])
{
    if (count == RUN && lies_at<RUN * sizeof(Value)>(from)) {
        const AlignedArray<Value, RUN> loaded = load_vector<RUN>(from);
        for (int k = 0; k < RUN; ++k)
            values[k] = loaded.at[k];
    } else {
        for (int k = 0; k < RUN; ++k)
            values[k] = from[k < count ? k : 0];
    }
}

template <class Value> WARPCAM_DEVICE void store_run(Value* to, int count, const Value (&values)[RUN])
{
    if (count == RUN && lies_at<RUN * sizeof(Value)>(to)) {
        AlignedArray<Value, RUN> stored;
        for (int k = 0; k < RUN; ++k)
            stored.at[k] = values[k];
        *reinterpret_cast<AlignedArray<Value, RUN>*>(to) = stored;
    } else {
        for (int k = 0; k < RUN; ++k)
            if (k < count)
                to[k] = values[k];
    }
}

// Writes map(number) for each number of a row, (world, number), from column `offset` on.
template <class Value, class Result, class Image_, class Out, class Map>
WARPCAM_DEVICE void map_run(const Image_& image, int offset, const Out& out, int index, const Map& map)
{
    const Run run = run_of(index, image.shape[1]);
    Value values[RUN];
    Result results[RUN];
    load_run<Value>(wp::address(image, run.world, run.first), run.count, values);
    for (int k = 0; k < RUN; ++k)
        results[k] = map(values[k]);
    store_run<Result>(wp::address(out, run.world, offset + run.first), run.count, results);
}

template <class Image_, class Out>
WARPCAM_DEVICE void copy_run(const Image_& image, int offset, const Out& out, int index)
{
    map_run<float, float>(image, offset, out, index, [](float value) { return value; });
}

template <class Image_, class Out>
WARPCAM_DEVICE void clip_run(const Image_& image, float beyond, const Out& out, int index)
{
    constexpr float MOST = 3.402823466e38f;
    map_run<float, float>(image, 0, out, index, [&](float value) { return value <= MOST ? value : beyond; });
}

template <class Image_, class Out> WARPCAM_DEVICE void negate_run(const Image_& image, const Out& out, int index)
{
    map_run<float, float>(image, 0, out, index, [](float value) { return -value; });
}

// `miss` for -1, `other` for every id that the table lacks.
template <class Image_, class Table, class Out>
WARPCAM_DEVICE void look_up_run(const Image_& image, const Table& table, int miss, int other, const Out& out, int index)
{
    map_run<int, int>(image, 0, out, index, [&](int id) {
        return id >= 0 && id < table.shape[0] ? table.data[id] : id == -1 ? miss : other;
    });
}

// The last of the objects is that of ids below 0.
template <class Image_, class Objects, class Out>
WARPCAM_DEVICE void name_run(const Image_& image, const Objects& objects, int offset, const Out& out, int index)
{
    map_run<int, wp::vec2i>(image, offset, out, index,
                            [&](int id) { return objects.data[id < 0 ? objects.shape[0] - 1 : id]; });
}

// Pixels of three or four bytes, (world, pixel, channel), as words: red shifted by `red` bits, blue by `blue`, green by
// 8; the highest byte is 255, or `miss_alpha` where a fourth is 0.
template <class Image_, class Out> WARPCAM_DEVICE void color_run(const Image_& image, int red, int blue, int miss_alpha,
                                                                 int offset, const Out& out, int index)
{
    const int channels = image.shape[2];
    const Run run = run_of(index, image.shape[1]);
    const unsigned char* from = wp::address(image, run.world, run.first, 0);
    unsigned words[RUN];
    if (channels == 4 && lies_at<4 * RUN>(from) && run.count == RUN) {
        load_run<unsigned>(reinterpret_cast<const unsigned*>(from), RUN, words);
    } else if (channels == 3 && lies_at<4>(from) && run.count == RUN) {
        const unsigned* three = reinterpret_cast<const unsigned*>(from);
        const unsigned a = three[0], b = three[1], c = three[2];
        words[0] = a;
        words[1] = a >> 24 | b << 8;
        words[2] = b >> 16 | c << 16;
        words[3] = c >> 8;
    } else {
        for (int k = 0; k < RUN; ++k) {
            const unsigned char* pixel = from + channels * (k < run.count ? k : 0);
            words[k] = pixel[0] | pixel[1] << 8 | pixel[2] << 16 | (channels == 4 ? unsigned(pixel[3]) << 24 : 0u);
        }
    }
    for (int k = 0; k < RUN; ++k) {
        const unsigned alpha = channels == 4 && words[k] >> 24 == 0u ? unsigned(miss_alpha) : 255u;
        words[k] = (words[k] & 255u) << red | (words[k] & 0xff00u) | (words[k] >> 16 & 255u) << blue | alpha << 24;
    }
    store_run<unsigned>(wp::address(out, run.world, offset + run.first), run.count, words);
}

}  // namespace warpcam
