// What one viewer still has to be sent: the newest message of each kind, and nothing older.
//
//   put(key, message)   takes the place of an unsent message of that key, else goes to the end
//   next()              the one that has waited longest
//
// Every message is a state (where the nodes are, which triangles there are, how the loops are), none a
// change: what a slow viewer is not sent, it does not need. So the box holds at most one message a key, and
// nobody waits for it. Thread safety: one thread. Cost: linear in the number of keys, which is a handful.
#pragma once

#include <cstdint>
#include <list>
#include <memory>
#include <string>

namespace hapticd {

struct ViewMessage {
  std::string key;
  bool binary = false;  // else UTF-8 JSON
  std::string bytes;
};
using SharedMessage = std::shared_ptr<const ViewMessage>;

class Outbox {
 public:
  void put(SharedMessage message) {
    for (SharedMessage& waiting : waiting_)
      if (waiting->key == message->key) {
        waiting = std::move(message);
        ++dropped_;
        return;
      }
    waiting_.push_back(std::move(message));
  }
  // Null: nothing waits.
  SharedMessage next() {
    if (waiting_.empty()) return nullptr;
    SharedMessage first = std::move(waiting_.front());
    waiting_.pop_front();
    return first;
  }
  std::size_t size() const noexcept { return waiting_.size(); }
  std::uint64_t dropped() const noexcept { return dropped_; }

 private:
  std::list<SharedMessage> waiting_;
  std::uint64_t dropped_ = 0;
};

}  // namespace hapticd
