// haptic view: a page in the browser that shows a running daemon, or a recording, as it is felt.
#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "server/dds/command.h"
#include "server/dds/network.h"
#include "server/files/usage.h"
#include "server/os/realtime.h"
#include "tools/cli/command.h"
#include "tools/cli/report.h"
#include "tools/view/live.h"
#include "tools/view/page_service.h"
#include "tools/view/playback.h"
#include "tools/view/remote_hand.h"

namespace hapticd {
namespace {

struct ViewOptions {
  PageServerSettings server;
  std::string recording, scene, topic, secure, role = "viewer", page;
  std::uint32_t domain = 0, device_id = 0;
  bool control = false;
  double duration = 0, idle = 0;
};

// {"reset": true} from a page: the daemon is asked, on a thread of its own, once at a time.
class ResetButton {
 public:
  explicit ResetButton(const Participant& participant) : participant_(participant) {}

  void hear(const std::string& text) {
    const nlohmann::json said = nlohmann::json::parse(text, nullptr, false);
    if (!said.is_object() || !said.contains("reset") || said["reset"] != true || busy_.exchange(true)) return;
    asking_ = std::jthread([this] {
      try {
        const CommandReply reply = ask_server(participant_, ServerCommand::reset, 5);
        if (!reply.done)
          std::fprintf(stderr, "haptic: reset: %s\n",
                       reply.heard ? reply.message.c_str() : "no daemon answered");
      } catch (const std::exception& e) {
        std::fprintf(stderr, "haptic: reset: %s\n", e.what());
      }
      busy_ = false;
    });
  }

 private:
  const Participant& participant_;
  std::atomic<bool> busy_{false};
  std::jthread asking_;
};

void serve(const ViewOptions& o, PagePoll poll, PageHear hear) {
  serve_page({.server = o.server,
              .command = "haptic view",
              .exposed = o.control ? "sees the scene and may take the hand" : "sees the scene",
              .duration = o.duration,
              .idle = o.idle},
             PageFiles(o.page.empty() ? page_folder() : std::filesystem::path(o.page)), poll, hear);
}

int view_recording(const ViewOptions& o) {
  if (o.scene.empty())
    throw UsageError(
        "--recording needs the scene in which it was made: --scene SCENE.yaml (a recording holds the "
        "motion; what the tissue did is computed again)");
  Playback playback(o.recording, o.topic, o.scene);
  serve(
      o, [&](bool) { return playback.poll(); },
      [&](std::uint64_t, const std::string& text) { playback.hear(text); });
  return playback.failed() ? 1 : 0;
}

int view_daemon(const ViewOptions& o) {
  std::optional<Security> security;
  if (!o.secure.empty()) security = security_files(o.secure, o.control ? "operator" : o.role);
  if (!o.control) stand_back();  // before there are threads
  const Domain domain(o.domain, viewer_dds_profile());
  const Participant participant(domain, security);
  LiveSource live(participant);
  std::optional<RemoteHand> hand;
  std::optional<ResetButton> reset;
  if (o.control) {
    hand.emplace(participant, o.device_id);
    reset.emplace(participant);
  }
  const auto silent_until = std::chrono::steady_clock::now() + std::chrono::seconds(5);
  bool said = false;
  serve(
      o,
      [&](bool watched) {
        std::vector<SharedMessage> messages = live.poll(watched);
        if (!said && !live.has_daemon() && std::chrono::steady_clock::now() > silent_until) {
          said = true;
          std::fprintf(stderr, "haptic: no daemon answers in %s; still listening\n",
                       dds_place(o.domain, "loopback").c_str());
        }
        if (hand)
          if (SharedMessage m = hand->poll(live.health(o.device_id))) messages.push_back(std::move(m));
        return messages;
      },
      [&](std::uint64_t viewer, const std::string& text) {
        if (hand) hand->hear(viewer, text);
        if (reset) reset->hear(text);
      });
  return 0;
}

}  // namespace

Command add_view(CLI::App& application) {
  auto o = std::make_shared<ViewOptions>();
  CLI::App* app = application.add_subcommand(
      "view",
      "Shows a running daemon, or a recording, in a browser: the tissue, the contact, the loops' health.");
  app->add_option("--port", o->server.port, "of the page; 0: any free one")->capture_default_str();
  app->add_option(
         "--listen", o->server.address,
         "address to listen on; others than loopback show the scene to whoever reaches this machine, "
         "without password or TLS")
      ->type_name("ADDRESS")
      ->capture_default_str();
  CLI::Option* domain = app->add_option("--domain", o->domain, "DDS domain of the daemon")
                            ->check(CLI::Range(0u, 230u))
                            ->capture_default_str();
  CLI::Option* recording = app->add_option("--recording", o->recording,
                                           "play this instead of a daemon: a rosbag2 directory, .db3 or CSV")
                               ->type_name("FILE")
                               ->excludes(domain);
  app->add_option("--scene", o->scene, "the scene that the recording was made in")
      ->type_name("SCENE.yaml")
      ->needs(recording);
  app->add_option("--topic", o->topic, "of a rosbag2: which of its topics with poses")->needs(recording);
  app->add_flag(
         "--control", o->control,
         "let a viewer be a device: a simulated hand follows the mouse. Not a haptic device: nobody feels it")
      ->excludes(recording);
  app->add_option("--device-id", o->device_id, "with --control: the device to be")->capture_default_str();
  app->add_option("--secure", o->secure, "keys for a daemon that runs with --secure")->type_name("DIR");
  app->add_option("--role", o->role, "whose keys of those; with --control: operator")
      ->check(CLI::IsMember({"viewer", "operator"}))
      ->capture_default_str();
  app->add_option("--page", o->page, "the page's files, if not the installed ones")->type_name("DIR");
  app->add_option("--duration", o->duration, "stop after so many seconds; 0: at Ctrl-C")
      ->check(not_negative)
      ->capture_default_str();
  app->add_option("--idle", o->idle, "stop after nobody has looked for so many seconds; 0: never")
      ->check(not_negative)
      ->capture_default_str();
  app->footer(
      "The daemon does not know who looks; stop and start either as you like.\n"
      "Example: haptic view --port 8080\n"
      "Example: haptic view --recording stroke --scene config/scenes/cataract/cataract.yaml");
  return {app, [o] { return o->recording.empty() ? view_daemon(*o) : view_recording(*o); }};
}

}  // namespace hapticd
