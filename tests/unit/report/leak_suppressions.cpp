extern "C" const char* __lsan_default_suppressions();

/// Fontconfig keeps its configuration and patterns until the process ends.
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libfontconfig\n";
}
