// Sequences of contact problems as a haptic loop meets them: seeded strokes over a surface, one problem each
// millisecond, linearised anew every 20 steps (a simulation step).
//
//   W = H C Hᵀ + J K⁻¹ Jᵀ,   δ_free = gap + n·(s_free − s) + J (X ⊖ X_lin),   slip from anchors (rows.h)
//
// A stroke comes down, presses, drags to and fro at up to 20 mm/s, turns a little, and lifts. The contacts of
// a linearisation are the `contacts` points of least gap. Anchors and linearisations follow an accurate
// reference solution, so every solver is given the same problems. Cases: round (tip 0.6 mm), blunt (4 mm),
// flat (a punch on the block, all conforming), duplicates (round, every point three times), two_bodies (a tip
// on each of two lenses), rigid (a punch on a plane, W of rank 6 and, with friction, the compliance that
// rows.h gives to rigid contacts), ill_conditioned (blunt, 25 points in each triangle, a coupling softer than
// the tissue), flat_stale (flat, 290 points under the punch), wedge and badly_scaled (drawn_contacts.h:
// another problem at each linearisation, whose free gaps move in a line until the next). Units: m, N.
// Deterministic: a function of case, sizes and seed.
#pragma once

#include <random>
#include <string>
#include <vector>

#include "physics/contact/instrument.h"
#include "tools/chart/solver/contact_surface.h"
#include "tools/chart/solver/drawn_contacts.h"

namespace hapticd {

enum class ContactCase {
  round,
  blunt,
  flat,
  duplicates,
  two_bodies,
  rigid,
  ill_conditioned,
  flat_stale,
  wedge,
  badly_scaled
};
const std::vector<std::string>& contact_case_names();  // in the enum's order

struct SequenceSettings {
  ContactCase kind = ContactCase::round;
  int contacts = 30;
  bool friction = true;  // three rows a contact, μ from 0.1 to 2 stroke by stroke; else one row
  std::uint64_t seed = 1;
  int steps_per_linearisation = 20;
  int steps_per_stroke = 500;
};

class ContactSequence {
 public:
  explicit ContactSequence(const SequenceSettings& settings);

  // The next problem; `reference` solves the present one (nothing at the first call).
  void advance(const VecX& reference);

  const MatX& W() const { return W_; }
  const MatX& W_unregularised() const { return W_raw_; }  // without the compliance given to rigid contacts
  const VecX& q() const { return q_; }
  const std::vector<double>& mu() const { return mu_; }
  std::uint64_t version() const { return version_; }  // counts W's
  int rows() const { return settings_.contacts * width_; }
  // For a vector of the previous linearisation, its values for the present contacts (same point): a warm
  // start.
  void carry(VecX& lambda) const;
  bool relinearised() const { return relinearised_; }

  // Wrench on the instrument; its length with torques divided by the tip's reach [N].
  Vec6 wrench(const VecX& lambda) const { return J_.transpose() * lambda; }
  double length(const Vec6& wrench) const;

 private:
  struct Contact {
    int point;
    Mat3 frame;
    Vec3 arm;
    double gap;
  };
  struct Stroke {
    Vec3 from, to;
    double depth, turn, cycles;
    Vec3 axis;
    double mu;
  };

  Vec3 place(const std::vector<Vec3>& x, int point) const;
  bool drawn() const;
  void draw();
  void new_stroke();
  Pose device(int step) const;
  void linearise();
  void measure_gap();
  void absorb(const VecX& reference);

  SequenceSettings settings_;
  int width_;
  ContactSurface surface_;
  Instrument instrument_;
  Vec6 K_inv_;
  double reach_ = 0;  // of the instrument's contact region [m]
  std::mt19937_64 random_;
  Stroke stroke_;
  int step_ = -1;
  std::uint64_t version_ = 0;
  bool relinearised_ = false;

  std::vector<Vec3> x_;            // under the reference's forces
  Pose X_, X_lin_, X_instrument_;  // device; instrument at the linearisation; under the reference's forces
  std::vector<Contact> contact_;
  std::vector<int> before_;     // per point: its contact in the previous linearisation, or −1
  std::vector<Vec3> anchor_;    // per point, instrument's frame
  std::vector<bool> anchored_;  // per point
  MatX H_, J_, W_, W_raw_;
  VecX q_;
  std::vector<double> mu_;
  VecX q_drawn_, motion_;  // of a problem that is drawn
};

}  // namespace hapticd
