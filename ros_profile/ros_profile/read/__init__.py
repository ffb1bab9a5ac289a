"""Readers: the bytes of one file in, what stands in it out. No I/O, no exception for any input.

Each reader is `read_<what>(data: bytes, file: str) -> SourceFile` (launch files: LaunchFile, package.xml: Manifest);
`file` is the path within the package. What cannot be read becomes a Problem in the result.
"""
