#include "tools/view/scene.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tools/view/frames.h"

namespace hapticd {
namespace {

SharedMessage message(std::string key, std::string bytes, bool binary = true) {
  return std::make_shared<const ViewMessage>(ViewMessage{std::move(key), binary, std::move(bytes)});
}

bool is_shell(const TetMesh& mesh, const BoundarySurface& surface) {
  std::vector<bool> used(mesh.nodes.size()), outside(mesh.nodes.size());
  for (const Tet& t : mesh.tets)
    for (const int n : t) used[static_cast<std::size_t>(n)] = true;
  for (const SurfaceFace& f : surface.faces())
    for (const int n : f.nodes) outside[static_cast<std::size_t>(n)] = true;
  return used == outside;
}

}  // namespace

std::vector<std::uint8_t> loose_tets(std::span<const int> across, std::span<const std::uint8_t> alive) {
  std::vector<int> piece(alive.size(), -1), size;
  std::vector<int> waiting;
  for (std::size_t begin = 0; begin < alive.size(); ++begin) {
    if (!alive[begin] || piece[begin] >= 0) continue;
    const int number = static_cast<int>(size.size());
    size.push_back(0);
    piece[begin] = number;
    waiting.assign(1, static_cast<int>(begin));
    while (!waiting.empty()) {
      const auto e = static_cast<std::size_t>(waiting.back());
      waiting.pop_back();
      ++size.back();
      for (std::size_t face = 4 * e; face < 4 * e + 4; ++face) {
        const int other = across[face] < 0 ? -1 : across[face] / 4;
        if (other < 0 || !alive[static_cast<std::size_t>(other)] ||
            piece[static_cast<std::size_t>(other)] >= 0)
          continue;
        piece[static_cast<std::size_t>(other)] = number;
        waiting.push_back(other);
      }
    }
  }
  const auto largest = static_cast<int>(std::max_element(size.begin(), size.end()) - size.begin());
  std::vector<std::uint8_t> loose(alive.size());
  for (std::size_t e = 0; e < alive.size(); ++e) loose[e] = piece[e] >= 0 && piece[e] != largest;
  return loose;
}

void ViewScene::tell_body(std::uint32_t id, const std::string& name, bool deformable, TetMesh mesh,
                          std::vector<std::uint32_t> opened) {
  Body body;
  body.name = name;
  body.deformable = deformable;
  for (const Vec3& x : mesh.nodes)
    for (int i = 0; i < 3; ++i) body.rest.push_back(static_cast<float>(x[i]));
  body.nodes = body.rest;
  body.alive.assign(mesh.tets.size(), 1);
  body.mesh = std::move(mesh);
  body.opened = std::move(opened);
  bodies_[id] = std::move(body);
  scene_changed_ = true;
}

void ViewScene::tell_instrument(std::uint32_t index, std::uint32_t count, ViewInstrument instrument) {
  instruments_[index] = std::move(instrument);
  instruments_.erase(instruments_.lower_bound(std::max(count, index + 1)), instruments_.end());
  scene_changed_ = true;
}

void ViewScene::tell_motion(std::uint32_t id, double time, std::span<const float> nodes,
                            std::span<const std::uint8_t> alive) {
  const auto found = bodies_.find(id);
  if (found == bodies_.end()) return;
  Body& body = found->second;
  if (nodes.size() != body.rest.size() || alive.size() != (body.alive.size() + 7) / 8) return;
  body.nodes.assign(nodes.begin(), nodes.end());
  for (std::size_t e = 0; e < body.alive.size(); ++e)
    body.alive[e] = static_cast<std::uint8_t>(alive[e / 8] >> (e % 8) & 1);
  body.time = time;
  body.moved = true;
}

// A contact of which nobody says who presses is the first instrument's, on tissue.
void ViewScene::tell_contacts(double time, std::span<const float> instruments,
                              std::span<const float> contacts, std::span<const std::uint8_t> pressing) {
  time_ = time;
  poses_.assign(instruments.begin(), instruments.end());
  contacts_.assign(contacts.begin(), contacts.end());
  pressing_.assign(pressing.begin(), pressing.end());
  const std::size_t said = pressing_.size() / 2;
  pressing_.resize(contacts_.size() / 7 * 2, 0);
  for (std::size_t i = said; i < pressing_.size() / 2; ++i) pressing_[2 * i + 1] = 255;
  contacts_changed_ = true;
}

// Brings the surface to what is alive.
void ViewScene::follow(Body& body) {
  std::vector<int> gone;
  bool back = false;
  for (std::size_t e = 0; e < body.alive.size(); ++e) {
    if (!body.alive[e] && body.drawn[e]) gone.push_back(static_cast<int>(e));
    back = back || (body.alive[e] && !body.drawn[e]);
  }
  if (back) {
    body.surface.emplace(body.mesh, body.opened);
    gone.clear();
    for (std::size_t e = 0; e < body.alive.size(); ++e)
      if (!body.alive[e]) gone.push_back(static_cast<int>(e));
  }
  if (!gone.empty()) body.surface->remove(gone);
  body.drawn = body.alive;
}

nlohmann::json ViewScene::description() const {
  nlohmann::json bodies = nlohmann::json::array();
  for (const auto& [id, body] : bodies_)
    bodies.push_back({{"id", id},
                      {"name", body.name},
                      {"deformable", body.deformable},
                      {"shell", body.shell},
                      {"nodes", body.mesh.nodes.size()},
                      {"tets", body.mesh.tets.size()}});
  nlohmann::json instruments = nlohmann::json::array();
  for (const auto& [index, instrument] : instruments_)
    instruments.push_back(
        {{"name", instrument.name}, {"device", instrument.device_id}, {"primitives", instrument.primitives}});
  return {{"kind", "scene"}, {"bodies", bodies}, {"instruments", instruments}};
}

std::vector<SharedMessage> ViewScene::messages() {
  std::vector<SharedMessage> out;
  for (auto& [id, body] : bodies_) {
    const std::string of = "/" + std::to_string(id);
    if (!body.moved && !body.is_new) continue;
    if (body.is_new) {
      body.surface.emplace(body.mesh, body.opened);
      body.across = faces_across(body.mesh.tets);
      body.shell = is_shell(body.mesh, *body.surface);
      body.drawn.assign(body.alive.size(), 1);
      if (body.deformable) body.strain.emplace(body.mesh.nodes, body.mesh.tets);
      out.push_back(message("rest" + of, rest_frame(id, body.rest)));
    }
    if (body.is_new || body.drawn != body.alive) {
      follow(body);
      const auto removed =
          static_cast<std::uint32_t>(std::count(body.alive.begin(), body.alive.end(), std::uint8_t{0}));
      out.push_back(message("surface" + of, surface_frame(id, removed, body.surface->faces(),
                                                          loose_tets(body.across, body.alive))));
    }
    if (body.deformable)
      out.push_back(message(
          "motion" + of, motion_frame(id, body.time, body.nodes, body.strain->of(body.nodes, body.alive))));
    body.is_new = body.moved = false;
  }
  // First of all, so that the page knows the bodies that the others are about.
  if (std::exchange(scene_changed_, false))
    out.insert(out.begin(), message("scene", description().dump(), false));
  if (std::exchange(contacts_changed_, false) && !poses_.empty())
    out.push_back(message("contacts", contacts_frame(time_, poses_, contacts_, pressing_)));
  return out;
}

}  // namespace hapticd
