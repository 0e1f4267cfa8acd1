#include "physics/contact/instruments.h"

#include <algorithm>

namespace hapticd {

InstrumentPoses displaced(const InstrumentPoses& X, const EachInstrument<Vec6>& d, double s) noexcept {
  InstrumentPoses out = X;
  for (int i = 0; i < max_instruments; ++i)
    if (X.present[i]) out[i] = displaced(X[i], s * d[i]);
  return out;
}

EachInstrument<Vec6> difference(const InstrumentPoses& X, const InstrumentPoses& Y) noexcept {
  EachInstrument<Vec6> d;
  for (int i = 0; i < max_instruments; ++i)
    if (X.present[i]) d[i] = difference(X[i], Y[i]);
  return d;
}

double longest(const EachInstrument<Vec6>& d) noexcept {
  double most = 0;
  for (const Vec6& of : d.value) most = std::max(most, of.head<3>().norm());
  return most;
}

}  // namespace hapticd
