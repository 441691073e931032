// Empty: the precompiled headers of Wholebody.cmake need a source.
