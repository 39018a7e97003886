// Table of the analytic shape types: a row for each, and the functions that pick one of them.
#pragma once
#include "shapes/plane.h"
#include "shapes/sphere.h"
#include "shapes/ellipsoid.h"
#include "shapes/capsule.h"
#include "shapes/cylinder.h"
#include "shapes/box.h"
#include "shapes/cone.h"
#include "shapes/barrel.h"

namespace warpcam {

template <class... Shapes> struct ShapeTable {};

// In the order in which kernels try them.
using AnalyticShapes = ShapeTable<PlaneTraits, SphereTraits, EllipsoidTraits, CapsuleTraits, CylinderTraits, BoxTraits,
                                  ConeTraits, BarrelTraits>;

// Bits of the types for which a trait holds: types_with([](auto shape) { return shape.IS_ROUND; }).
template <class Trait, class... Shapes> constexpr int types_with(Trait trait, ShapeTable<Shapes...>)
{
    return (0 | ... | (trait(Shapes()) ? 1 << Shapes::TYPE : 0));
}
template <class Trait> constexpr int types_with(Trait trait) { return types_with(trait, AnalyticShapes()); }

constexpr int ANALYTIC_TYPES = types_with([](auto) { return true; });

template <int GEOMETRY, bool KNOWN, class Use, class Shape, class... Others>
WARPCAM_DEVICE void visit_rows(int type, const Use& use, ShapeTable<Shape, Others...>)
{
    constexpr bool LAST = (GEOMETRY & (0 | ... | (1 << Others::TYPE))) == 0;
    if constexpr ((GEOMETRY >> Shape::TYPE & 1) != 0) {
        if ((KNOWN && LAST) || type == Shape::TYPE) {
            use(Shape());
            return;
        }
    }
    if constexpr (!LAST)
        visit_rows<GEOMETRY, KNOWN>(type, use, ShapeTable<Others...>());
}

// Calls `use` with the traits of a type that is known at run time only, out of a set known at compile time; not for
// other types.
template <int GEOMETRY, class Use> WARPCAM_DEVICE void visit_shape(int type, const Use& use)
{
    visit_rows<GEOMETRY, false>(type, use, AnalyticShapes());
}

// Likewise for a type that is one of the set: the last of them is not looked for.
template <int GEOMETRY, class Use> WARPCAM_DEVICE void visit_known_shape(int type, const Use& use)
{
    if constexpr ((GEOMETRY & ANALYTIC_TYPES) != 0)
        visit_rows<GEOMETRY, true>(type, use, AnalyticShapes());
}

}  // namespace warpcam
