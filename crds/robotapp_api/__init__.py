"""The RobotApp API as code: models, schema generator, pure rules, claim protocol and API client."""
