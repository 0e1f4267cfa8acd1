// HTTP server of /metrics for this machine: GET and HEAD, on a loopback address alone.
//
// Everything else is refused: another path with 404, another method with 405, a request whose Host is no
// loopback name with 403. The last protects against a web page elsewhere that makes a browser here ask by a
// name which its author points at 127.0.0.1. At most 16 connections are open, each for at most 5 s. `page`
// makes the text in the server's own thread, of ordinary priority. Errors: the constructor throws
// std::invalid_argument for an address that is not loopback or not an address, std::runtime_error where the
// port cannot be had.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace hapticd {

class HttpServer;

// The fault of such an address; empty: none.
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
  std::unique_ptr<HttpServer> http_;
};

}  // namespace hapticd
