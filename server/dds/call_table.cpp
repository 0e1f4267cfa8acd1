#include "server/dds/call_table.h"

#include <dlfcn.h>
#include <elf.h>
#include <link.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <cstring>

namespace hapticd {
namespace {

struct Wanted {
  const char* library;
  const char* function;
  void* to;
  void* before = nullptr;
};

// glibc has moved these pointers to where the library lies, except on a few architectures.
template <typename T>
const T* address(const dl_phdr_info& library, ElfW(Addr) value) noexcept {
  return reinterpret_cast<const T*>(value < library.dlpi_addr ? library.dlpi_addr + value : value);
}

// The table may be read-only since it was filled in (RELRO). Returns what was there; null: it cannot be
// written.
void* write_entry(ElfW(Addr) at, void* to) noexcept {
  const auto page = static_cast<ElfW(Addr)>(sysconf(_SC_PAGESIZE));
  void* const begin = reinterpret_cast<void*>(at / page * page);
  if (mprotect(begin, page, PROT_READ | PROT_WRITE) != 0) return nullptr;
  return std::atomic_ref<void*>(*reinterpret_cast<void**>(at)).exchange(to);
}

// An entry that was never used leads back into its own library, which would look the function up.
void* resolved(void* entry, const dl_phdr_info& library, const char* function) noexcept {
  Dl_info found{};
  const bool own = dladdr(entry, &found) && found.dli_fbase == reinterpret_cast<void*>(library.dlpi_addr);
  return own ? dlsym(RTLD_DEFAULT, function) : entry;
}

class Table {
 public:
  explicit Table(const dl_phdr_info& library) : library_(library) {
    for (int i = 0; i < library.dlpi_phnum; ++i)
      if (library.dlpi_phdr[i].p_type == PT_DYNAMIC) read(library.dlpi_addr + library.dlpi_phdr[i].p_vaddr);
  }
  void* redirect(const char* function, void* to) const noexcept {
    if (!symbols_ || !names_) return nullptr;
    void* const call = redirect(calls_, calls_size_, function, to);
    void* const pointer = redirect(data_, data_size_, function, to);
    return call ? call : pointer;
  }

 private:
  void read(ElfW(Addr) dynamic) noexcept {
    for (auto* d = reinterpret_cast<const ElfW(Dyn)*>(dynamic); d->d_tag != DT_NULL; ++d) {
      if (d->d_tag == DT_SYMTAB) symbols_ = address<ElfW(Sym)>(library_, d->d_un.d_ptr);
      if (d->d_tag == DT_STRTAB) names_ = address<char>(library_, d->d_un.d_ptr);
      if (d->d_tag == DT_JMPREL) calls_ = address<ElfW(Rela)>(library_, d->d_un.d_ptr);
      if (d->d_tag == DT_PLTRELSZ) calls_size_ = d->d_un.d_val;
      if (d->d_tag == DT_RELA) data_ = address<ElfW(Rela)>(library_, d->d_un.d_ptr);
      if (d->d_tag == DT_RELASZ) data_size_ = d->d_un.d_val;
    }
  }
  void* redirect(const ElfW(Rela) * rows, std::size_t bytes, const char* function, void* to) const noexcept {
    void* before = nullptr;
    for (std::size_t i = 0; rows && i < bytes / sizeof *rows; ++i) {
      const auto symbol = ELF64_R_SYM(rows[i].r_info);
      if (symbol == 0 || std::strcmp(names_ + symbols_[symbol].st_name, function) != 0) continue;
      if (void* const entry = write_entry(library_.dlpi_addr + rows[i].r_offset, to))
        before = resolved(entry, library_, function);
    }
    return before;
  }

  const dl_phdr_info& library_;
  const ElfW(Sym) * symbols_ = nullptr;
  const char* names_ = nullptr;
  const ElfW(Rela) * calls_ = nullptr, *data_ = nullptr;
  std::size_t calls_size_ = 0, data_size_ = 0;
};

int look(dl_phdr_info* library, std::size_t, void* argument) noexcept {
  auto& wanted = *static_cast<Wanted*>(argument);
  const char* const slash = std::strrchr(library->dlpi_name, '/');
  const char* const name = slash ? slash + 1 : library->dlpi_name;
  if (std::strncmp(name, wanted.library, std::strlen(wanted.library)) == 0)
    if (void* const before = Table(*library).redirect(wanted.function, wanted.to)) wanted.before = before;
  return 0;
}

}  // namespace

void* redirect_calls(const char* library, const char* function, void* to) noexcept {
  Wanted wanted{library, function, to};
  dl_iterate_phdr(look, &wanted);
  return wanted.before;
}

}  // namespace hapticd
