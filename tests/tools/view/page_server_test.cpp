// The page's server on a socket: what it gives, what it refuses, and that a slow viewer holds nobody up.
#include "tools/view/page_server.h"

#include <gtest/gtest.h>

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <mutex>
#include <thread>

#include "server/files/input_error.h"
#include "tests/tools/run_command.h"
#include "tools/cli/command.h"

namespace hapticd {
namespace {

// A folder with a page, and what must not be found beside it.
struct Page {
  ScratchDirectory scratch;
  std::string folder = scratch.file("page");
  Page() {
    std::filesystem::create_directories(folder + "/vendor");
    std::ofstream(folder + "/index.html") << "<p>page</p>";
    std::ofstream(folder + "/vendor/three.js") << "export {};";
    std::ofstream(folder + "/.hidden.js") << "hidden";
    std::ofstream(folder + "/notes.txt") << "notes";
    scratch.file("secret.html", "secret");
    std::filesystem::create_symlink(scratch.file("secret.html"), folder + "/link.html");
  }
};

class Connection {
 public:
  explicit Connection(std::uint16_t port, in_addr address = {htonl(INADDR_LOOPBACK)},
                      int receive_buffer = 0) {
    fd_ = socket(AF_INET, SOCK_STREAM, 0);
    if (receive_buffer > 0) setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    timeval patience{5, 0};
    setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_addr = address;
    to.sin_port = htons(port);
    connected_ = connect(fd_, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0;
  }
  ~Connection() { close(fd_); }
  bool connected() const { return connected_; }
  void send(const std::string& text) {
    ASSERT_EQ(write(fd_, text.data(), text.size()), ssize_t(text.size()));
  }
  std::string read(std::size_t n) {
    while (buffer_.size() < n) {
      char part[65536];
      const ssize_t got = ::read(fd_, part, sizeof part);
      if (got <= 0) break;
      buffer_.append(part, static_cast<std::size_t>(got));
    }
    const std::string out = buffer_.substr(0, n);
    buffer_.erase(0, n);
    return out;
  }
  std::string read_until(const std::string& end) {
    std::string out;
    while (!out.ends_with(end)) {
      const std::string next = read(1);
      if (next.empty()) break;
      out += next;
    }
    return out;
  }
  // The payload of the next frame; only what a server sends, unmasked.
  std::string frame() {
    const std::string head = read(2);
    if (head.size() < 2) return "";
    std::size_t n = static_cast<unsigned char>(head[1]) & 0x7f, more = n == 126 ? 2 : n == 127 ? 8 : 0;
    if (more > 0) {
      n = 0;
      for (const char c : read(more)) n = n << 8 | static_cast<unsigned char>(c);
    }
    return read(n);
  }

 private:
  int fd_ = -1;
  bool connected_ = false;
  std::string buffer_;
};

const PageServerSettings any_port{"127.0.0.1", 0};

std::string request(const std::string& target, const std::string& more = "Host: localhost\r\n",
                    const std::string& method = "GET") {
  return method + " " + target + " HTTP/1.1\r\n" + more + "Connection: close\r\n\r\n";
}
std::string upgrade(const std::string& more) {
  return "GET /live HTTP/1.1\r\n" + more +
         "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
         "Sec-WebSocket-Version: 13\r\n\r\n";
}

std::string answer(const PageServer& server, const std::string& text) {
  Connection c(server.port());
  c.send(text);
  return c.read(1 << 20);
}
int code(const std::string& answer) { return answer.size() > 12 ? std::stoi(answer.substr(9, 3)) : 0; }

TEST(PageFiles, ArePartOfThePageOrNotThere) {
  const Page page;
  const PageFiles files(page.folder);
  EXPECT_EQ(files.count(), 2u);
  ASSERT_TRUE(files.find("/"));
  EXPECT_EQ(files.find("/")->bytes, "<p>page</p>");
  EXPECT_EQ(files.find("/vendor/three.js?x=1")->type, "text/javascript; charset=utf-8");
  for (const char* path :
       {"", "index.html", "/../secret.html", "/vendor/../index.html", "/%2e%2e/secret.html", "/vendor",
        "//index.html", "/.hidden.js", "/notes.txt", "/link.html", "/index.html/", "/\\..\\secret.html"})
    EXPECT_EQ(files.find(path), nullptr) << path;
  EXPECT_THROW(PageFiles(page.scratch.file("none")), InputError);
}

TEST(PageServer, GivesThePageAndRefusesWhatIsNotIt) {
  const Page page;
  PageServer server(any_port, PageFiles(page.folder), [](auto, const auto&) {});
  const std::string whole = answer(server, request("/"));
  EXPECT_EQ(code(whole), 200);
  EXPECT_TRUE(whole.ends_with("<p>page</p>")) << whole;
  EXPECT_NE(whole.find("Content-Security-Policy: default-src 'none'"), std::string::npos);
  const std::string head = answer(server, request("/", "Host: localhost\r\n", "HEAD"));
  EXPECT_EQ(code(head), 200);
  EXPECT_TRUE(head.ends_with("\r\n\r\n")) << head;
  EXPECT_EQ(code(answer(server, request("/../secret.html"))), 404);
  EXPECT_EQ(code(answer(server, request("/", "Host: localhost\r\n", "DELETE"))), 405);
  EXPECT_EQ(code(answer(server, request("/live"))), 404);
  // DNS rebinding, and pages of elsewhere.
  EXPECT_EQ(code(answer(server, request("/", "Host: evil.example\r\n"))), 403);
  EXPECT_EQ(code(answer(server, request("/", "Host: 10.0.0.1\r\n"))), 403);
  EXPECT_EQ(code(answer(server, request("/", ""))), 403);
  EXPECT_EQ(code(answer(server, upgrade("Host: evil.example\r\nOrigin: http://evil.example\r\n"))), 403);
  EXPECT_EQ(code(answer(server, upgrade("Host: localhost\r\nOrigin: http://evil.example\r\n"))), 403);
  EXPECT_EQ(code(answer(server, upgrade("Host: localhost\r\nOrigin: null\r\n"))), 403);
  // Nonsense and too much ends the connection, and the server goes on.
  answer(server, "\x16\x03\x01 nonsense\r\n\r\n");
  answer(server, request("/" + std::string(20'000, 'a')));
  EXPECT_EQ(code(answer(server, request("/"))), 200);
}

TEST(PageServer, OtherMachinesFindNobodyListening) {
  const Page page;
  PageServer server(any_port, PageFiles(page.folder), [](auto, const auto&) {});
  EXPECT_TRUE(Connection(server.port()).connected());
  ifaddrs* all = nullptr;
  ASSERT_EQ(getifaddrs(&all), 0);
  int tried = 0;
  for (const ifaddrs* i = all; i; i = i->ifa_next) {
    if (!i->ifa_addr || i->ifa_addr->sa_family != AF_INET) continue;
    const in_addr address = reinterpret_cast<const sockaddr_in*>(i->ifa_addr)->sin_addr;
    if (ntohl(address.s_addr) >> 24 == 127) continue;
    ++tried;
    EXPECT_FALSE(Connection(server.port(), address).connected()) << inet_ntoa(address);
  }
  freeifaddrs(all);
  if (tried == 0) GTEST_SKIP() << "this machine has no other address";
}

TEST(PageServer, FaultsAreNamed) {
  const Page page;
  PageServer server(any_port, PageFiles(page.folder), [](auto, const auto&) {});
  try {
    PageServer second({"127.0.0.1", server.port()}, PageFiles(page.folder), [](auto, const auto&) {});
    ADD_FAILURE() << "the port was had twice";
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("--port 0"), std::string::npos) << e.what();
  }
  EXPECT_THROW(PageServer({"here", 0}, PageFiles(page.folder), [](auto, const auto&) {}), UsageError);
}

SharedMessage numbered(const std::string& key, int n, std::size_t size) {
  std::string bytes = std::to_string(n) + " ";
  bytes.resize(size, 'x');
  return std::make_shared<const ViewMessage>(ViewMessage{key, true, std::move(bytes)});
}

TEST(PageServer, ALateViewerSeesWhatThereIsAndASlowOneSkips) {
  const Page page;
  PageServer server(any_port, PageFiles(page.folder), [](auto, const auto&) {});
  server.put(numbered("first", 1, 10));
  Connection slow(server.port(), {htonl(INADDR_LOOPBACK)}, 4096), quick(server.port());
  for (Connection* c : {&slow, &quick}) {
    c->send(upgrade("Host: localhost:1\r\nOrigin: http://localhost:1\r\n"));
    EXPECT_EQ(code(c->read_until("\r\n\r\n")), 101);
    EXPECT_EQ(std::stoi(c->frame()), 1);
  }
  EXPECT_EQ(server.viewers(), 2);
  constexpr int count = 400;
  int newest_quick = 0;
  for (int n = 1; n <= count; ++n) {
    server.put(numbered("motion", n, 100'000));
    newest_quick = std::stoi(quick.frame());
    EXPECT_EQ(newest_quick, n);  // the slow one is in nobody's way
  }
  int frames = 0, newest = 0;
  while (newest < count) {
    const std::string frame = slow.frame();
    ASSERT_FALSE(frame.empty());
    EXPECT_GT(std::stoi(frame), newest);
    newest = std::stoi(frame);
    ++frames;
  }
  EXPECT_LT(frames, 60);
  EXPECT_EQ(server.dropped(), static_cast<std::uint64_t>(count - frames));
}

TEST(PageServer, TextsComeBackAndGoingIsNoticed) {
  const Page page;
  std::vector<std::pair<std::uint64_t, std::string>> heard;
  std::mutex mutex;
  PageServer server(any_port, PageFiles(page.folder), [&](std::uint64_t viewer, const std::string& text) {
    const std::lock_guard lock(mutex);
    heard.emplace_back(viewer, text);
  });
  const auto count = [&] {
    const std::lock_guard lock(mutex);
    return heard.size();
  };
  const auto wait = [&](std::size_t n) {
    for (int i = 0; i < 500 && count() < n; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return count() == n;
  };
  {
    Connection c(server.port());
    c.send(upgrade("Host: 127.0.0.1\r\n"));
    c.read_until("\r\n\r\n");
    c.send(std::string("\x81\x82\0\0\0\0hi", 8));  // masked with zeros
    ASSERT_TRUE(wait(1));
    // More than a text may be: the connection ends.
    c.send(std::string("\x81\xfe\x20\x00\0\0\0\0", 8) + std::string(0x2000, 'x'));
    ASSERT_TRUE(wait(2));
  }
  EXPECT_EQ(heard[0].second, "hi");
  EXPECT_EQ(heard[1].second, "");
  EXPECT_EQ(heard[0].first, heard[1].first);
  EXPECT_EQ(server.viewers(), 0);
}

}  // namespace
}  // namespace hapticd
