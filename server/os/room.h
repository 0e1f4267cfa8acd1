// Whether the machine gives a process what it is about to take: said before it begins, in words.
//
// Without these questions Cyclone DDS crashes where a thread or a descriptor is missing, OpenBLAS waits for
// ever where there is no address space, and at a cgroup's limit the kernel kills without a word. Each
// function takes what is asked for and gives it back: what others take meanwhile is not seen.
// Errors: std::runtime_error that says how much is needed, how much there is, and which limit holds it.
// Thread safety: any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

namespace hapticd {

void require_threads(int needed);
void require_descriptors(int needed);
void require_address_space(std::size_t bytes);
bool may_lock_memory();  // all of it (mlockall)
// What of it a process keeps in memory; `remedy` is said where there is less.
void require_memory(std::int64_t bytes, const std::string& remedy);

// What is left in memory for this process [bytes]: of the machine, and of each cgroup that it is in (version
// 1 or 2), with what the kernel would drop of files. root: before /proc and /sys. Very large where nothing is
// known.
struct MemoryLeft {
  std::int64_t bytes = 0;
  std::string limit;  // what says so: "MemAvailable", or a cgroup's file
};
MemoryLeft memory_left(const std::filesystem::path& root = "/");

}  // namespace hapticd
