"""What a ROS package needs, read from its source, with evidence: `generate_profile(path)`.

    model/    what is read and what is concluded, as plain data
    read/     readers: the bytes of one file in, what stands in it out (pure)
    decide/   closure of launch files, edges, classification (pure)
    output/   text, JSON, annotations, Rigelfile, RobotApp, differences (pure)
    files/    finding and reading files within bounds, the cache (I/O)

Nothing that is read is ever run.
"""
