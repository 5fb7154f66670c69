#include "client_sdk/capture/storage_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <utility>

#include <fmt/format.h>

namespace rustle::capture {
namespace {

std::error_code last_error() {
  return {errno, std::generic_category()};
}

class PosixOutputFile final : public OutputFile {
 public:
  PosixOutputFile(int descriptor, std::string name) : descriptor_(descriptor), name_(std::move(name)) {}
  ~PosixOutputFile() override {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  PosixOutputFile(const PosixOutputFile&) = delete;
  PosixOutputFile& operator=(const PosixOutputFile&) = delete;

  std::error_code write(std::string_view bytes) override {
    while (!bytes.empty()) {
      const ssize_t written = ::write(descriptor_, bytes.data(), bytes.size());
      if (written < 0) {
        if (errno == EINTR) continue;
        return last_error();
      }
      bytes.remove_prefix(static_cast<std::size_t>(written));
    }
    return {};
  }

  std::error_code sync() override {
    // Pipes and devices cannot be synced; they keep nothing that could be lost.
    if (::fdatasync(descriptor_) != 0 && errno != EINVAL && errno != EROFS) return last_error();
    if (name_is_durable_) return {};
    const std::filesystem::path folder = std::filesystem::path(name_).parent_path();
    const int folder_descriptor = ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder_descriptor >= 0) {
      ::fsync(folder_descriptor);
      ::close(folder_descriptor);
    }
    name_is_durable_ = true;
    return {};
  }

  std::error_code truncate(std::uint64_t size_bytes) override {
    if (::ftruncate(descriptor_, static_cast<off_t>(size_bytes)) != 0) return last_error();
    if (::lseek(descriptor_, static_cast<off_t>(size_bytes), SEEK_SET) < 0) return last_error();
    return {};
  }

  std::error_code close() override {
    const int descriptor = std::exchange(descriptor_, -1);
    if (descriptor >= 0 && ::close(descriptor) != 0) return last_error();
    return {};
  }

  const std::string& name() const override { return name_; }

 private:
  int descriptor_;
  std::string name_;
  bool name_is_durable_ = false;
};

class PosixInputFile final : public InputFile {
 public:
  PosixInputFile(int descriptor, std::string name) : descriptor_(descriptor), name_(std::move(name)) {}
  ~PosixInputFile() override { ::close(descriptor_); }
  PosixInputFile(const PosixInputFile&) = delete;
  PosixInputFile& operator=(const PosixInputFile&) = delete;

  tl::expected<std::size_t, std::error_code> read(std::span<char> out) override {
    std::size_t filled = 0;
    while (filled < out.size()) {
      const ssize_t got = ::read(descriptor_, out.data() + filled, out.size() - filled);
      if (got == 0) break;
      if (got < 0) {
        if (errno == EINTR) continue;
        return tl::unexpected(last_error());
      }
      filled += static_cast<std::size_t>(got);
    }
    return filled;
  }

  const std::string& name() const override { return name_; }

 private:
  int descriptor_;
  std::string name_;
};

std::string remedy_for(std::error_code cause) {
  switch (cause.value()) {
    case ENOSPC:
      return "free space on that disk or record to another one";
    case EDQUOT:
      return "free space within the user's disk quota or record elsewhere";
    case EACCES:
    case EPERM:
    case EROFS:
      return "choose a folder this user may write to, or mend the permissions";
    case EEXIST:
      return "choose another name, or move that file away";
    case ENOENT:
    case ENOTDIR:
      return "check the path; folders are not made on the way";
    case EISDIR:
      return "give a file, not a folder";
    case EBADF:
      return "the file was closed meanwhile; start a new recording";
    case EFBIG:
      return "the file system or a limit forbids larger files; start a new recording";
    case EMFILE:
    case ENFILE:
      return "raise the limit of open files (ulimit -n)";
    case EIO:
      return "the disk reports a fault; record to another one";
    default:
      return "check the path and the disk";
  }
}

tl::expected<std::unique_ptr<OutputFile>, StorageError> create(const std::filesystem::path& path, int flag) {
  const int descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | flag, 0666);
  if (descriptor < 0) return tl::unexpected(storage_error(path.string(), "create the file", last_error()));
  return std::make_unique<PosixOutputFile>(descriptor, path.string());
}

}  // namespace

std::string StorageError::text() const {
  return fmt::format("{}: {}; {}", file_name, message, remedy);
}

StorageError storage_error(const std::string& file_name, const std::string& action, std::error_code cause) {
  return {file_name, fmt::format("cannot {}: {}", action, cause.message()), remedy_for(cause)};
}

tl::expected<std::unique_ptr<OutputFile>, StorageError> create_file(const std::filesystem::path& path) {
  return create(path, O_TRUNC);
}

tl::expected<std::unique_ptr<OutputFile>, StorageError> create_new_file(const std::filesystem::path& path) {
  return create(path, O_EXCL);
}

tl::expected<std::unique_ptr<InputFile>, StorageError> open_file(const std::filesystem::path& path) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return tl::unexpected(storage_error(path.string(), "open the file", last_error()));
  struct stat status {};
  if (::fstat(descriptor, &status) == 0 && S_ISDIR(status.st_mode)) {
    ::close(descriptor);
    return tl::unexpected(storage_error(path.string(), "open the file", std::make_error_code(std::errc::is_a_directory)));
  }
  return std::make_unique<PosixInputFile>(descriptor, path.string());
}

}  // namespace rustle::capture
