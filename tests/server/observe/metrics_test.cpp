#include "server/observe/metrics.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <regex>
#include <set>
#include <sstream>

#include <gtest/gtest.h>

#include "server/observe/metrics_server.h"

namespace hapticd {
namespace {

MetricsSource device(std::uint32_t id) {
  MetricsSource m;
  m.device_id = id;
  m.ticks = 1000;
  Histogram wake;
  for (std::int64_t ns : {1'000, 5'000, 5'000, 1'000'000, 500'000'000}) wake.record(ns);
  m.wake = wake.snapshot();
  return m;
}

std::string line_of(const std::string& text, const std::string& begin) {
  const std::size_t at = text.find("\n" + begin);
  return at == std::string::npos ? "" : text.substr(at + 1, text.find('\n', at + 1) - at - 1);
}

// 1 µs, 5 µs twice, 1 ms, 0.5 s: cumulative counts by hand.
TEST(Metrics, AHistogramIsCumulativeAndComplete) {
  const std::string text = prometheus_text({}, {device(0)});
  const std::string name = "hapticd_haptic_wake_seconds";
  EXPECT_EQ(line_of(text, name + "_bucket{device=\"0\",le=\"4.096e-06\"}"),
            name + "_bucket{device=\"0\",le=\"4.096e-06\"} 1");
  EXPECT_EQ(line_of(text, name + "_bucket{device=\"0\",le=\"6.144e-06\"}"),
            name + "_bucket{device=\"0\",le=\"6.144e-06\"} 3");
  EXPECT_EQ(line_of(text, name + "_bucket{device=\"0\",le=\"0.001048576\"}"),
            name + "_bucket{device=\"0\",le=\"0.001048576\"} 4");
  EXPECT_EQ(line_of(text, name + "_bucket{device=\"0\",le=\"+Inf\"}"),
            name + "_bucket{device=\"0\",le=\"+Inf\"} 5");
  EXPECT_EQ(line_of(text, name + "_count"), name + "_count{device=\"0\"} 5");
  EXPECT_EQ(line_of(text, name + "_sum"), name + "_sum{device=\"0\"} 0.501011");
}

// Every line is a comment or a sample; each name's TYPE stands once, before its samples, which follow one
// another.
TEST(Metrics, IsInTheTextFormat) {
  std::istringstream text(
      prometheus_text({.version = "1\"x\\", .resident_bytes = 1e8, .uptime_s = 3, .grants_refused = 1},
                      {device(0), device(7)}));
  const std::regex sample(
      R"re(([a-z_]+)(\{[a-z]+="(\\.|[^"\\])*"(,[a-z]+="[^"]*")*\})? (-?[0-9.e+-]+|\+Inf))re");
  std::set<std::string> types;
  std::string current;
  int samples = 0;
  for (std::string line; std::getline(text, line);) {
    if (line.starts_with("# HELP ")) continue;
    if (line.starts_with("# TYPE ")) {
      current = line.substr(7, line.find(' ', 7) - 7);
      EXPECT_TRUE(types.insert(current).second) << line;
      continue;
    }
    std::smatch match;
    ASSERT_TRUE(std::regex_match(line, match, sample)) << line;
    EXPECT_TRUE(match[1].str().starts_with(current)) << line;
    ++samples;
  }
  EXPECT_GT(samples, 100);
  for (const char* name :
       {"hapticd_haptic_deadline_misses_total", "hapticd_states_rejected_total", "hapticd_solver_caps_total",
        "hapticd_elements_removed_total", "hapticd_haptic_step_seconds", "hapticd_simulation_step_seconds",
        "hapticd_armed", "hapticd_second_daemon", "hapticd_foreign_forces_total"})
    EXPECT_TRUE(types.contains(name)) << name;
}

TEST(Metrics, DevicesOfOneWorldAreTold) {
  MetricsSource left = device(3), right = device(5), other = device(7);
  left.instrument = "left \"hand\"";
  right.instrument = "right";
  other.world = 1;
  const std::string text = prometheus_text({}, {left, right, other});
  for (const char* line :
       {"hapticd_device_info{device=\"3\",instrument=\"left \\\"hand\\\"\",world=\"0\"} 1\n",
        "hapticd_device_info{device=\"5\",instrument=\"right\",world=\"0\"} 1\n",
        "hapticd_device_info{device=\"7\",instrument=\"\",world=\"1\"} 1\n",
        "hapticd_haptic_ticks_total{device=\"5\"} 1000\n"})
    EXPECT_NE(text.find(line), std::string::npos) << line;
}

// Braces of a sample hold the station beside what else it has; without a station no sample names one.
TEST(Metrics, AStationIsALabelOfEverySample) {
  std::istringstream text(prometheus_text({.version = "1", .station = "lab3"}, {device(0)}));
  int samples = 0;
  for (std::string line; std::getline(text, line);) {
    if (line.empty() || line[0] == '#') continue;
    ++samples;
    EXPECT_NE(line.find("station=\"lab3\""), std::string::npos) << line;
  }
  EXPECT_GT(samples, 100);
  EXPECT_EQ(prometheus_text({.version = "1"}, {device(0)}).find("station"), std::string::npos);
}

// −1: refused.
int connected(std::uint16_t port) {
  const int s = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(port);
  inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
  if (connect(s, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0) return s;
  close(s);
  return -1;
}

std::string ask(std::uint16_t port, const std::string& request) {
  const int s = connected(port);
  std::string answer;
  if (s >= 0 && write(s, request.data(), request.size()) == static_cast<ssize_t>(request.size())) {
    char part[4096];
    for (ssize_t n; (n = read(s, part, sizeof part)) > 0;) answer.append(part, static_cast<std::size_t>(n));
  }
  close(s);
  return answer;
}

std::string get(const std::string& path, const std::string& host) {
  return "GET " + path + " HTTP/1.1\r\nHost: " + host + "\r\nConnection: close\r\n\r\n";
}

TEST(MetricsServer, AnswersGetOnLoopbackAndNothingElse) {
  MetricsServer server("0", [] { return std::string("figures 1\n"); });
  ASSERT_GT(server.port(), 0);
  const std::string here = "localhost:" + std::to_string(server.port());
  const std::string good = ask(server.port(), get("/metrics", here));
  EXPECT_TRUE(good.starts_with("HTTP/1.1 200 ")) << good;
  EXPECT_NE(good.find("text/plain; version=0.0.4"), std::string::npos);
  EXPECT_TRUE(good.ends_with("\r\n\r\nfigures 1\n"));
  EXPECT_TRUE(ask(server.port(), get("/metrics", "[::1]")).starts_with("HTTP/1.1 200 "));
  EXPECT_TRUE(ask(server.port(), get("/", here)).starts_with("HTTP/1.1 404 "));
  EXPECT_TRUE(ask(server.port(), get("/metrics", "evil.example")).starts_with("HTTP/1.1 403 "));
  EXPECT_TRUE(ask(server.port(), get("/metrics", "127.0.0.1.evil.example")).starts_with("HTTP/1.1 403 "));
  EXPECT_TRUE(
      ask(server.port(),
          "POST /metrics HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1\r\nConnection: close\r\n\r\nx")
          .starts_with("HTTP/1.1 405 "));
  const std::string garbage = ask(server.port(), std::string("\0\xff\r\n\r\n", 6));
  EXPECT_EQ(garbage.find("200"), std::string::npos);
  EXPECT_TRUE(ask(server.port(), get("/metrics", here)).starts_with("HTTP/1.1 200 "));
}

TEST(MetricsServer, TwoHostsAreRefused) {
  MetricsServer server("0", [] { return std::string("figures 1\n"); });
  EXPECT_TRUE(ask(server.port(), "GET /metrics HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n")
                  .starts_with("HTTP/1.1 400 "));
}

// Who says nothing, or a letter now and then, keeps nobody out.
TEST(MetricsServer, IdleConnectionsMakeRoom) {
  MetricsServer server("0", [] { return std::string("figures 1\n"); });
  std::vector<int> idle;
  for (int i = 0; i < 64; ++i) {
    idle.push_back(connected(server.port()));
    ASSERT_GE(idle.back(), 0);
    ASSERT_EQ(write(idle.back(), "G", static_cast<std::size_t>(i % 2)), i % 2);
  }
  const auto begun = std::chrono::steady_clock::now();
  EXPECT_TRUE(ask(server.port(), get("/metrics", "localhost")).starts_with("HTTP/1.1 200 "));
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(1));
  for (const int s : idle) close(s);
}

// Nor does who asks for more than sockets hold, and reads none of it.
TEST(MetricsServer, SlowReadersBlockNobody) {
  MetricsServer server("0", [] { return std::string(16'000'000, 'f'); });
  const std::string request = get("/metrics", "localhost");
  std::vector<int> slow;
  for (int i = 0; i < 15; ++i) {
    slow.push_back(connected(server.port()));
    ASSERT_EQ(write(slow.back(), request.data(), request.size()), static_cast<ssize_t>(request.size()));
  }
  const auto begun = std::chrono::steady_clock::now();
  EXPECT_GT(ask(server.port(), request).size(), 16'000'000u);
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(2));
  for (const int s : slow) close(s);
}

TEST(MetricsServer, RefusesWhatIsNotLoopback) {
  for (const char* address : {"0.0.0.0:9464", "192.168.1.2:9464", "[::]:9464", "[2001:db8::1]:9464",
                              "example.org:9464", "70000", "-1", "", "9464x", "127.0.0.1:"})
    EXPECT_NE(metrics_address_fault(address), "") << address;
  for (const char* address : {"9464", "127.0.0.1:9464", "127.1.2.3:0", "[::1]:9464", "localhost:9464"})
    EXPECT_EQ(metrics_address_fault(address), "") << address;
}

}  // namespace
}  // namespace hapticd
