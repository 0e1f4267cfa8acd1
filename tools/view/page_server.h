// The page over HTTP, and what it shows over WebSocket, on a loopback address unless told otherwise.
//
//   GET, HEAD /…    a file of the page (page_files.h)
//   GET /live       a WebSocket: first every message there is, then each new one; texts come back
//
// A message is kept under its key until another takes its place, so that a late viewer sees what an early one
// does. Each viewer has an outbox (outbox.h) and at most one message on its way: a slow one skips, none makes
// the sender or another viewer wait. A request that names another host than a loopback one, or comes from a
// page of elsewhere, is answered 403 (host_name.h); with an address of its own choice, any address counts. At
// most 32 connections at a time, requests of 8 kB, texts of 4 kB. Thread safety: put and viewers belong to
// any thread; `heard` runs in the server's own thread, at ordinary priority. Errors: the constructor throws
// UsageError for an address that is none, std::runtime_error where the port is taken.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "tools/view/outbox.h"
#include "tools/view/page_files.h"

namespace hapticd {

struct PageServerSettings {
  std::string address = "127.0.0.1";
  std::uint16_t port = 8080;  // 0: any free one
};

class PageServer {
 public:
  // heard(viewer, text): a text of that viewer; empty: it has gone.
  PageServer(const PageServerSettings& settings, PageFiles files,
             std::function<void(std::uint64_t, const std::string&)> heard);
  ~PageServer();
  PageServer(const PageServer&) = delete;
  PageServer& operator=(const PageServer&) = delete;

  void put(SharedMessage message);
  // Forgets the messages whose key begins so, for viewers to come.
  void forget(const std::string& key_begins);
  int viewers() const noexcept;
  std::uint64_t dropped() const noexcept;  // messages that slow viewers skipped
  std::uint16_t port() const noexcept;

 private:
  struct Running;
  std::unique_ptr<Running> running_;
};

}  // namespace hapticd
