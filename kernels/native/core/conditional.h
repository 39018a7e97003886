// Types chosen by a condition, as those of <type_traits>, which NVRTC does not have.
#pragma once

namespace warpcam {

template <bool CONDITION, class Then, class Else> struct Conditional {
    using type = Then;
};
template <class Then, class Else> struct Conditional<false, Then, Else> {
    using type = Else;
};
template <bool CONDITION, class Then, class Else> using conditional_t =
    typename Conditional<CONDITION, Then, Else>::type;

// Stands for a member or an argument that is not there.
struct None {};

template <bool THERE, class Value> using optional_t = conditional_t<THERE, Value, None>;

}  // namespace warpcam
