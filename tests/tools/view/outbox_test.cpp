// A slow viewer skips, and in the end has what everybody has.
#include "tools/view/outbox.h"

#include <gtest/gtest.h>

#include <map>
#include <random>

namespace hapticd {
namespace {

SharedMessage message(const std::string& key, const std::string& bytes) {
  return std::make_shared<const ViewMessage>(ViewMessage{key, false, bytes});
}

TEST(Outbox, TheNewestOfAKeyTakesItsPlace) {
  Outbox box;
  box.put(message("a", "1"));
  box.put(message("b", "1"));
  box.put(message("a", "2"));
  EXPECT_EQ(box.size(), 2u);
  EXPECT_EQ(box.dropped(), 1u);
  EXPECT_EQ(box.next()->bytes, "2");  // and keeps its turn
  EXPECT_EQ(box.next()->key, "b");
  EXPECT_EQ(box.next(), nullptr);
}

// However rarely it is served: the box never holds more than a message a key, and when it is empty the
// viewer's newest of each key is the newest there is.
TEST(Outbox, NothingIsLostThatIsStillTrue) {
  std::mt19937 random(1);
  for (int viewer = 0; viewer < 50; ++viewer) {
    Outbox box;
    std::map<std::string, std::string> truth, seen;
    for (int i = 0; i < 2000; ++i) {
      const std::string key(1, static_cast<char>('a' + random() % 6));
      truth[key] = std::to_string(i);
      box.put(message(key, truth[key]));
      ASSERT_LE(box.size(), 6u);
      if (random() % 20 == 0)
        if (const SharedMessage m = box.next()) seen[m->key] = m->bytes;
    }
    while (const SharedMessage m = box.next()) seen[m->key] = m->bytes;
    EXPECT_EQ(seen, truth);
  }
}

}  // namespace
}  // namespace hapticd
