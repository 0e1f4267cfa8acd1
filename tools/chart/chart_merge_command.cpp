// haptic chart merge: parts of a run, made with --shard, as the figures of one.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>
#include <regex>

#include "server/files/input_error.h"
#include "server/files/paths.h"
#include "tools/chart/chart.h"
#include "tools/chart/shard.h"
#include "tools/cli/command.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string folder;
  bool force = false, no_pictures = false;
};

ShardFile read_part(const fs::path& file) {
  ShardFile part{file, nlohmann::ordered_json::parse(read_bytes(file), nullptr, false)};
  if (part.json.is_discarded()) throw InputError(file, 0, "", "is no JSON");
  return part;
}

// STEM_iofn.json of a folder, by stem.
std::map<std::string, std::vector<ShardFile>> parts_in(const fs::path& folder) {
  static const std::regex name(R"((.+)_\d+of\d+\.json)");
  if (!fs::is_directory(folder)) throw InputError(folder, 0, "", "is no folder");
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::map<std::string, std::vector<ShardFile>> parts;
  for (const fs::path& file : files) {
    std::smatch found;
    const std::string text = file.filename().string();
    if (std::regex_match(text, found, name)) parts[found[1]].push_back(read_part(file));
  }
  if (parts.empty())
    throw InputError(folder, 0, "", "has no parts: --shard i/n --out of a run leaves NAME_iofn.json");
  return parts;
}

// The script that draws these figures, and where to; force's needs forces over time, which parts do not keep.
void draw_merged(const std::string& stem, const std::string& figures, const fs::path& folder) {
  if (stem == "stability") draw("plot_stability.py", figures, folder.string());
  if (stem == "lcp" || stem == "tissue")
    draw("plot_chart_" + stem + ".py", figures, (folder / (stem + ".png")).string());
}

int merge(const Options& o) {
  const fs::path folder = o.folder;
  for (const auto& [stem, parts] : parts_in(folder)) {
    const fs::path figures = folder / (stem + ".json"), table = folder / (stem + ".csv");
    const OutputRule rule(o.force);
    rule.require_figures("DIR", figures);
    write_json(figures.string(), merge_shards(parts));
    if (const std::string lines = merge_tables(parts, "points"); !lines.empty()) {
      rule.require_table("DIR", table, lines.substr(0, lines.find('\n') + 1));
      write_file(table.string(), lines);
    }
    if (!o.no_pictures) draw_merged(stem, figures.string(), folder);
    std::printf("%s: %zu parts\n", figures.c_str(), parts.size());
  }
  return 0;
}

}  // namespace

Command add_chart_merge(CLI::App& chart) {
  auto options = std::make_shared<Options>();
  CLI::App* app = chart.add_subcommand("merge",
                                       "Joins the parts that --shard i/n left in a folder, of a chart or of "
                                       "haptic stability, to the figures of one run.");
  app->add_option("DIR", options->folder,
                  "the --out of all parts; NAME.json, NAME.csv and pictures come there")
      ->required();
  app->add_flag("--no-pictures", options->no_pictures, "figures alone");
  add_force_option(*app, options->force);
  app->footer(
      "Example: for i in 1 2 3; do haptic stability --quick --shard $i/3 --out DIR & done; wait; haptic "
      "chart merge DIR");
  return {app, [options] { return merge(*options); }};
}

}  // namespace hapticd
