/* The algorithm of haptic/channel.h for Spin: one index with a new bit, three slots written in place, two
 * words each, every interleaving. Exchange is one atomic step, as on the machine; with -DBROKEN it is a
 * load and then a store, and the check must fail. What the memory orderings are for is beyond a model of
 * interleavings: channel_relacy.cpp checks those on the header itself.
 *
 * Properties: nothing torn; never backwards; taken once means newer; {back, middle, front} is a permutation
 * whenever nobody is inside an exchange; the newest is seen in the end (the assertion after both have
 * ended); wait-free: neither side has a loop or waits on the other, so Spin finds no invalid end state.
 * Example: spin -a channel.pml && cc -O2 -DSAFETY -o pan pan.c && ./pan
 */
#define PUBLISHES 5
#define TAKES 5
#define NEW 4
#define INDEX 3

byte first[3], second[3];
byte middle = 1, back = 0, front = 2;
byte seen = 0, ended = 0;

inline exchange(own, next) {
#ifdef BROKEN
  held = middle; middle = next;
#else
  d_step { held = middle; middle = next; }
#endif
  own = held & INDEX; held = 0
}

inline take() {
  if
  :: middle & NEW -> exchange(front, front); fresh = 1
  :: else -> fresh = 0
  fi
}

proctype writer() {
  byte n = 1, held;
  do
  :: n <= PUBLISHES ->
     first[back] = n;
     second[back] = n;
     exchange(back, (back | NEW));
     n++
  :: else -> break
  od;
  ended++
}

proctype reader() {
  byte k = 0, held, a, b;
  bit fresh;
  do
  :: k < TAKES ->
     take();
     a = first[front];
     b = second[front];
     assert(a == b);
     assert((fresh && a > seen) || (!fresh && a == seen));
     seen = a; a = 0; b = 0;
     k++
  :: else -> break
  od;
  ended++
}

init {
  byte held;
  bit fresh;
  atomic { run writer(); run reader() }
  ended == 2;
  assert(back != front && back != (middle & INDEX) && front != (middle & INDEX));
  take();
  assert(first[front] == PUBLISHES && second[front] == PUBLISHES)
}
