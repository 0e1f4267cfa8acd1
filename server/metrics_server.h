// HTTP for those who ask this machine for /metrics: GET and HEAD, on a loopback address alone.
//
// Everything else is refused: another path 404, another method 405, a request whose Host is no loopback name
// 403 (a web page of elsewhere that a browser here was made to ask, by a name that its author points at
// 127.0.0.1). At most 16 connections, each let go after 5 s. The page is made by `page` in the server's own
// thread, of ordinary priority. Errors: the constructor throws std::invalid_argument for an address that is
// not loopback or not an address, std::runtime_error where the port cannot be had.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace hapticd {

// What is wrong with such an address; empty: nothing.
std::string metrics_address_fault(const std::string& address);

class MetricsServer {
 public:
  // address: "9464" (127.0.0.1), "127.0.0.1:9464" or "[::1]:9464"; port 0: any free one.
  MetricsServer(const std::string& address, std::function<std::string()> page);
  ~MetricsServer();
  MetricsServer(const MetricsServer&) = delete;
  MetricsServer& operator=(const MetricsServer&) = delete;

  std::uint16_t port() const noexcept;

 private:
  struct Http;
  std::unique_ptr<Http> http_;
};

}  // namespace hapticd
